// Asks the rays of `cargo bench --bench rays` of Embree 3: robust, high build quality, one ray at a time, one thread.
//
//   mkdir -p target/rays && DSCENE_EXPORT_RAYS=target/rays cargo bench --bench rays
//   c++ -O3 -march=native -std=c++17 docs/peers/embree_rays.cpp -lembree3 -o target/embree_rays    (Debian: libembree-dev)
//   target/embree_rays target/rays
//
// Prints million rays a second, the best of nine rounds, and how many rays hit something.

#include <embree3/rtcore.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <vector>

static std::vector<float> read(const std::filesystem::path& path) {
    std::vector<float> numbers(std::filesystem::file_size(path) / sizeof(float));
    std::ifstream(path, std::ios::binary).read(reinterpret_cast<char*>(numbers.data()), numbers.size() * sizeof(float));
    return numbers;
}

static RTCScene build(RTCDevice device, const std::vector<float>& corners) {
    const unsigned triangles = corners.size() / 9;
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* vertices = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * triangles);
    std::memcpy(vertices, corners.data(), corners.size() * sizeof(float));
    void* indices = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles);
    for (unsigned i = 0; i < 3 * triangles; ++i) static_cast<unsigned*>(indices)[i] = i;
    rtcSetGeometryBuildQuality(mesh, RTC_BUILD_QUALITY_HIGH);
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene, mesh);
    rtcCommitScene(scene);
    return scene;
}

// Rays that hit something: any, or the closest.
static size_t ask(RTCScene scene, const std::vector<float>& rays, bool any) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    size_t hits = 0;
    for (size_t i = 0; i < rays.size(); i += 8) {
        const float* r = &rays[i];
        RTCRayHit query;
        query.ray = {r[0], r[1], r[2], r[6], r[3], r[4], r[5], 0.0f, r[7], ~0u, 0, 0};
        query.hit.geomID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        if (any) {
            rtcOccluded1(scene, &context, &query.ray);
            hits += query.ray.tfar < 0.0f;
        } else {
            rtcIntersect1(scene, &context, &query);
            hits += query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
        }
    }
    return hits;
}

int main(int count, char** words) {
    if (count != 2) return std::fprintf(stderr, "usage: embree_rays FOLDER\n"), 2;
    RTCDevice device = rtcNewDevice("threads=1");
    std::vector<std::filesystem::path> scenes;
    for (const auto& entry : std::filesystem::directory_iterator(words[1]))
        if (entry.path().extension() == ".triangles") scenes.push_back(entry.path());
    std::sort(scenes.begin(), scenes.end());
    for (auto& path : scenes) {
        RTCScene scene = build(device, read(path));
        for (const char* kind : {"primary", "bounce", "shadow"}) {
            const auto rays = read(path.replace_extension(kind));
            double best = std::numeric_limits<double>::infinity();
            size_t hits = 0;
            for (int round = 0; round < 9; ++round) {
                const auto start = std::chrono::steady_clock::now();
                hits = ask(scene, rays, kind[0] == 's');
                const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
                best = std::min(best, taken.count());
            }
            const size_t n = rays.size() / 8;
            std::printf("%s %s: %.1f, %zu of %zu hit\n", path.stem().c_str(), kind, n / best / 1e6, hits, n);
        }
        rtcReleaseScene(scene);
    }
    rtcReleaseDevice(device);
}
