#!/usr/bin/env python3
"""Mitsuba 3's derivatives on the scenes of `cargo bench --bench efficiency`, measured the same way.

    pip install mitsuba numpy          (and a libLLVM, version 17 or newer: apt-get install libllvm19)
    cargo bench --bench efficiency -- --export target/efficiency
    python3 docs/peers/mitsuba_efficiency.py target/efficiency > target/mitsuba.jsonl
    cargo bench --bench efficiency -- --json > target/dscene.jsonl
    cargo bench --bench efficiency -- --table target/dscene.jsonl target/mitsuba.jsonl

The scenes, the adjoint image of the loss (a ramp) and the parameter's velocities are read from the exported files, so they are
the same numbers. Every setting that makes sense is tried with a few seeds (guiding none, grid and octree, also with the
undocumented attributes that make guiding affordable on a CPU; two sample counts). Of those that agree with the reference (or of all,
if none does) the one with the least variance × CPU time is measured again with fresh seeds, and that is the row printed. Kernels are warm: the first gradient is not counted. CPU seconds are
the process's, over all threads. `loss` is the primal, for a check that both programs render the same scene.
"""
import argparse, glob, json, math, os, resource, subprocess, sys, tempfile, time
import ctypes.util
import importlib.util


def llvm():
    names = ("LLVM-21", "LLVM-20", "LLVM-19", "LLVM-18", "LLVM-17", "LLVM")
    return next((found for n in names if (found := ctypes.util.find_library(n))), "libLLVM.so")


def cpu_now():
    r = resource.getrusage(resource.RUSAGE_SELF)
    return r.ru_utime + r.ru_stime


class Timer:
    def __enter__(self):
        self.start = cpu_now()
        return self

    def __exit__(self, *_):
        self.cpu = cpu_now() - self.start


# ---- which cases, which settings -----------------------------------------------------------------------------------

def refusal(case):
    """Why Mitsuba cannot do the case; None if it can."""
    if case["camera"]["projection"] != "perspective":
        return "no such camera in its projective integrators"
    smooth = [s["material"]["ior"] for s in case["shapes"] if s["material"].get("roughness", 0) is None]
    if any(v["slot"] in (["texels", i] for i in smooth) for v in case["velocities"]):
        return "no derivative in the index of smooth glass"
    if case["output"] != "radiance":
        return "channels of the first hit have no boundary term"
    for v in case["velocities"]:
        what = v["slot"][0]
        if what in ("camera", "environment rotation", "light placement"):
            return "no derivative in the " + ("camera" if what == "camera" else what)
    if any(s["emission"] and s["emission"]["two_sided"] for s in case["shapes"]):
        return "area lights have one side"
    return None


def settings(case):
    """(name, integrator, attributes, samples per pixel)"""
    spp, depth = case["spp"], case["bounces"] + 1
    if case["method"] == "both":
        return [("ptracer", dict(type="ptracer", max_depth=depth, rr_depth=100), {}, n) for n in (spp, 4 * spp, 16 * spp)]
    moves = any(v["slot"][0] in ("vertices", "normals") for v in case["velocities"])
    if not moves:
        prb = dict(type="prb", max_depth=depth, rr_depth=100)
        return [("prb", prb, {}, n) for n in (spp, 4 * spp)]
    if case["bounces"] == 0:
        return [("direct_projective, sppi 0", dict(type="direct_projective", sppi=0), {}, n) for n in (spp, 4 * spp, 16 * spp)]
    affordable = {"proj_seed_spp": 4, "octree_extra_leaf_sample": 16}
    grid = {"proj_seed_spp": 16, "guiding_grid_reso": [1000, 32, 32]}
    out = []
    kinds = [("direct_projective", {})] if case["bounces"] == 1 else []
    kinds += [("prb_projective", dict(max_depth=depth, rr_depth=100))] if case["bounces"] > 1 else []
    for kind, more in kinds:
        for n in (spp, 4 * spp):
            out.append((kind + ", no guiding", dict(type=kind, guiding="none", **more), {}, n))
            out.append((kind + ", octree 4/16", dict(type=kind, **more), affordable, n))
        out.append((kind + ", grid 1000×32×32", dict(type=kind, guiding="grid", **more), grid, 4 * spp))
    return out


def default_settings(case):
    """The defaults: minutes a gradient on a CPU."""
    depth = case["bounces"] + 1
    kind = dict(type="direct_projective") if depth == 2 else dict(type="prb_projective", max_depth=depth, rr_depth=100)
    return [(kind["type"] + ", octree (default)", kind, {}, 4 * case["spp"])]


def biased(pilot, reference):
    """Whether a setting's few seeds are off by more than 4 standard errors and 5 %."""
    if reference is None:
        return False
    error = math.hypot(pilot["std"] / math.sqrt(pilot["seeds"]), reference["error"])
    return not abs(pilot["value"] - reference["value"]) < max(4 * error, 0.05 * abs(reference["value"]))


# ---- building a scene ----------------------------------------------------------------------------------------------

class Case:
    def __init__(self, path):
        import numpy as np
        self.np = np
        self.case = json.load(open(path))
        self.words = np.fromfile(path[:-5] + ".bin", dtype="<f4")

    def floats(self, span, *shape):
        return self.words[span[0]:span[0] + span[1]].reshape(*shape) if shape else self.words[span[0]:span[0] + span[1]]

    def texture(self, i):
        t = self.case["textures"][i]
        return self.floats(t["data"], t["height"], t["width"], t["channels"]), t

    def constant(self, i):
        data, t = self.texture(i)
        assert t["width"] == t["height"] == 1
        return [float(x) for x in data.ravel()]

    def ply(self, mesh, path):
        np = self.np
        v = self.floats(mesh["vertices"], -1, 3)
        f = self.floats(mesh["faces"]).view("<u4").reshape(-1, 3)
        uvs = self.floats(mesh["uvs"], -1, 2) if mesh["uvs"] else None
        normals = self.floats(mesh["normals"], -1, 3) if mesh["normals"] else None
        columns, header = [v], "property float x\nproperty float y\nproperty float z\n"
        if normals is not None:
            columns.append(normals)
            header += "property float nx\nproperty float ny\nproperty float nz\n"
        if uvs is not None:
            columns.append(uvs)
            header += "property float u\nproperty float v\n"
        faces = np.empty(len(f), dtype=[("n", "u1"), ("i", "<u4", 3)])
        faces["n"], faces["i"] = 3, f
        with open(path, "wb") as out:
            out.write(("ply\nformat binary_little_endian 1.0\nelement vertex %d\n%selement face %d\n"
                       "property list uchar int vertex_indices\nend_header\n" % (len(v), header, len(f))).encode())
            out.write(np.hstack(columns).astype("<f4").tobytes())
            out.write(faces.tobytes())

    def colour(self, mi, i, power=1):
        data, t = self.texture(i)
        if t["width"] == t["height"] == 1:
            values = [x ** power for x in self.constant(i)]
            return values[0] if t["channels"] == 1 else {"type": "rgb", "value": values}
        return {"type": "bitmap", "bitmap": mi.Bitmap(self.np.ascontiguousarray(data ** power)), "raw": True,
                "format": "variant", "filter_type": t["filter"], "wrap_mode": t["wrap"]}

    def material(self, mi, s):
        m, kind = s["material"], s["material"]["kind"]
        if kind == "black":
            inner = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}}
        elif kind == "diffuse":
            inner = {"type": "diffuse", "reflectance": self.colour(mi, m["reflectance"])}
        elif kind == "mirror":
            inner = {"type": "conductor", "material": "none", "specular_reflectance": self.colour(mi, m["reflectance"])}
        elif kind == "conductor":
            assert self.constant(m["reflectance"]) == [1.0] * 3, "Schlick's Fresnel is 1 only for a reflectance of 1"
            inner = {"type": "roughconductor", "material": "none", "distribution": "ggx",
                     "alpha": self.colour(mi, m["roughness"], power=2)}
        elif kind == "dielectric":
            ior = {"int_ior": self.constant(m["ior"])[0], "ext_ior": 1.0}
            if m["roughness"] is None:
                return {"type": "dielectric", **ior}
            return {"type": "roughdielectric", "distribution": "ggx", "alpha": self.colour(mi, m["roughness"], power=2), **ior}
        else:
            raise ValueError("material " + kind)
        if s["coat"]:
            # The nearest that it has: light may also be reflected back to the base, so that the losses differ.
            assert kind == "diffuse" and self.constant(s["coat"]["weight"]) == [1.0]
            inner = {"type": "roughplastic", "distribution": "ggx", "alpha": self.colour(mi, s["coat"]["roughness"], power=2),
                     "int_ior": 1.5, "ext_ior": 1.0, "diffuse_reflectance": inner["reflectance"]}
        if s["normals"] is not None:
            inner = {"type": "normalmap", "normalmap": self.colour(mi, s["normals"]), "bsdf": inner}
        return {"type": "twosided", "bsdf": inner}

    def emitter(self, mi, folder):
        np = self.np
        e = self.case["environment"]
        data, t = self.texture(e["texture"])
        if t["width"] == t["height"] == 1:
            return {"type": "constant", "radiance": {"type": "rgb", "value": self.constant(e["texture"])}}
        # Their texels sit on the map's border and the pole, ours in the middle of cells; u differs by half a turn.
        w, h = 2 * t["width"], 2 * t["height"] + 1
        u = ((np.arange(w) / w + 0.5) % 1.0) * t["width"] - 0.5
        v = np.clip(np.arange(h) / (h - 1) * t["height"] - 0.5, 0, t["height"] - 1)
        u0, v0 = np.floor(u).astype(int), np.minimum(np.floor(v).astype(int), t["height"] - 2)
        fu, fv = (u - u0)[None, :, None], (v - v0)[:, None, None]
        at = lambda j, i: data[j][:, i % t["width"]]
        mixed = ((1 - fv) * ((1 - fu) * at(v0, u0) + fu * at(v0, u0 + 1))
                 + fv * ((1 - fu) * at(v0 + 1, u0) + fu * at(v0 + 1, u0 + 1)))
        m = np.eye(4)
        m[:3, :3] = np.array(e["rotation"]).reshape(3, 3)
        return {"type": "envmap", "bitmap": mi.Bitmap(mixed.astype(np.float32)), "to_world": mi.ScalarTransform4f(m)}

    def scene(self, mi, folder, spp):
        np, c = self.np, self.case["camera"]
        right, up, forward = (np.array(r) for r in c["frame"])
        m = np.eye(4)
        m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = -right, up, forward, c["origin"]
        sensor = {"type": "perspective", "fov_axis": "x", "fov": 2 * math.degrees(math.atan(c["scale"][0])),
                  "near_clip": 0.001, "far_clip": 10000.0, "to_world": mi.ScalarTransform4f(m),
                  "sampler": {"type": "independent", "sample_count": spp},
                  "film": {"type": "hdrfilm", "width": c["width"], "height": c["height"], "rfilter": {"type": c["filter"]},
                           "sample_border": False, "pixel_format": "rgb", "component_format": "float32"}}
        kind = "ptracer" if self.case["method"] == "both" else "path"
        d = {"type": "scene", "integrator": {"type": kind, "max_depth": self.case["bounces"] + 1, "rr_depth": 100},
             "sensor": sensor}
        for i, s in enumerate(self.case["shapes"]):
            path = os.path.join(folder, "%d.ply" % i)
            self.ply(s["mesh"], path)
            shape = {"type": "ply", "filename": path, "face_normals": s["mesh"]["normals"] is None, "bsdf": self.material(mi, s)}
            if s["emission"]:
                shape["emitter"] = {"type": "area", "radiance": self.colour(mi, s["emission"]["radiance"])}
            d["shape%d" % i] = shape
        for i, l in enumerate(self.case["delta_lights"]):
            power = {"type": "rgb", "value": l["power"]}
            d["light%d" % i] = ({"type": "point", "position": l["position"], "intensity": power} if l["kind"] == "point"
                                else {"type": "directional", "direction": l["direction"], "irradiance": power})
        if self.case["environment"]:
            d["environment"] = self.emitter(mi, folder)
        return mi.load_dict(d, optimize=False)

    def targets(self, params):
        """(key, velocity) of everything that moves, in Mitsuba's parameters."""
        np, out = self.np, []
        for v in self.case["velocities"]:
            (what, index), data = v["slot"], self.floats(v["data"]).astype(np.float64)
            if what == "vertices":
                out.append(("shape%d.vertex_positions" % index, data))
            elif what == "normals":
                raise ValueError("meshes are exported with face normals")
            elif what == "texels":
                out += self.texel_targets(params, index, data)
            elif what == "light power":
                raise ValueError(what)
        return out

    def texel_targets(self, params, index, velocity):
        np, out = self.np, []
        values = self.texture(index)[0].ravel().astype(np.float64)
        suffix = ".data" if self.case["textures"][index]["width"] > 1 else ".value"
        for i, s in enumerate(self.case["shapes"]):
            m, e = s["material"], s["emission"]
            if e and e["radiance"] == index:
                out.append(("shape%d.emitter.radiance%s" % (i, suffix), velocity))
            read = {"normals": s["normals"], "coat": s["coat"] and s["coat"]["roughness"], **m}
            for name, theirs, factor in (("reflectance", "reflectance", 1.0), ("roughness", "alpha", 2 * values),
                                         ("coat", "alpha", 2 * values), ("ior", "eta", 1.0), ("normals", "normalmap", 1.0)):
                if read.get(name) == index:
                    # Some numbers are parameters of their own, others textures.
                    stems = (theirs + suffix, theirs) if suffix == ".value" else (theirs + suffix,)
                    keys = [k for k in params.keys() if k.startswith("shape%d." % i) and k.endswith(stems)]
                    out.append((keys[0], velocity * factor))
        return out


# ---- measuring one case (a process of its own) ---------------------------------------------------------------------

def measure(path, a):
    import numpy as np
    import mitsuba as mi, drjit as dr
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    case = Case(path)
    c = case.case
    size = c["camera"]["width"]
    ramp = (np.arange(size) + 0.5) / size
    ramp = ramp[None, :, None] if c["ramp"] == "x" else ramp[:, None, None]
    w = (np.broadcast_to(ramp, (size, size, 3)) / (size * size * 3)).astype(np.float32)
    row = {"scene": c["scene"], "param": c["param"], "kind": c["kind"]}
    with tempfile.TemporaryDirectory() as folder:
        scene = case.scene(mi, folder, c["spp"])
    with dr.suspend_grad():
        images = [np.array(mi.render(scene, spp=64, seed=100 + k)).astype(np.float64) for k in range(2)]
    row["loss"] = float(np.mean([(image * w).sum() for image in images]))
    row["loss_expected"] = c["loss"]
    if a.primal:
        return row
    params = mi.traverse(scene)
    targets = case.targets(params)
    for key, _ in targets:
        dr.enable_grad(params[key])
    params.update()
    adjoint = mi.TensorXf(w)

    def gradient(integrator, seed, spp):
        for key, _ in targets:
            dr.clear_grad(params[key])
        integrator.render_backward(scene, params, adjoint, seed=seed, spp=spp)
        total = sum(float((np.array(dr.grad(params[key])).astype(np.float64).ravel() * v).sum()) for key, v in targets)
        dr.sync_thread()
        return total

    def sample(integrator, spp, seeds, seed, seconds, least=3):
        gradient(integrator, seed, spp)
        values, cpus, start = [], [], time.perf_counter()
        for k in range(seeds):
            with Timer() as t:
                values.append(gradient(integrator, seed + 1 + k, spp))
            cpus.append(t.cpu)
            if time.perf_counter() - start > seconds and len(values) >= least:
                break
        values = np.array(values)
        std = float(values.std(ddof=1))
        cpu = float(np.mean(cpus))
        return {"value": float(values.mean()), "std": std, "seeds": len(values), "cpu_seconds": cpu,
                "cost": std * std * cpu, "nonfinite": int((~np.isfinite(values)).sum())}

    tried, begun = [], time.perf_counter()
    for name, integrator, attributes, spp in (default_settings(c) if a.default else settings(c)):
        if tried and time.perf_counter() - begun > a.patience:
            break
        integrator = mi.load_dict(integrator)
        for k, v in attributes.items():
            assert hasattr(integrator, k), k
            setattr(integrator, k, v)
        label = "%s, %d spp" % (name, spp)
        try:
            pilot = sample(integrator, spp, a.pilot, 1000, a.seconds / 3)
        except Exception as e:  # an octree that overflows, a plugin that refuses
            print(label, str(e)[:200], file=sys.stderr)
            continue
        print(c["scene"], "/", c["param"], label, pilot, file=sys.stderr, flush=True)
        tried.append((biased(pilot, c["reference"]), pilot["cost"] if pilot["std"] > 0 else math.inf, label, integrator, spp))
    if not tried:
        return dict(row, error="every setting failed")
    _, _, label, integrator, spp = min(tried, key=lambda t: t[:2])
    # Rare events make a few gradients seem quiet that are not.
    best = sample(integrator, spp, a.seeds, 5000, a.seconds, 8)
    return dict(row, setting=label, tried=len(tried), reference=c["reference"], **best)


def forward(a):
    """Samples a CPU second of the path tracer, path length 5, in the Cornell box and in rough glass."""
    import mitsuba as mi, drjit as dr
    mi.set_variant("llvm_ad_rgb")
    cases = [Case(path) for path in sorted(glob.glob(os.path.join(a.folder, "*.json")))]
    for name, number in (("Cornell box", "17"), ("rough glass", "22")):
        case = next(c for c in cases if c.case["scene"].startswith(number) and c.case["bounces"] == 4)
        with tempfile.TemporaryDirectory() as folder:
            scene = case.scene(mi, folder, 16)
        best = {"scene": name}
        for spp in (16, 64):
            cpu = []
            for seed in range(6):
                with Timer() as t:
                    dr.eval(mi.render(scene, spp=spp, seed=seed))
                    dr.sync_thread()
                cpu.append(t.cpu)
            size = case.case["camera"]["width"]
            rate = size * size * spp / (sum(cpu[1:]) / len(cpu[1:]))
            if rate > best.get("samples_per_cpu_second", 0):
                best.update({"spp": spp, "samples_per_cpu_second": rate})
        yield {"forward": best}


def main():
    p = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter, description=__doc__)
    p.add_argument("folder")
    p.add_argument("--scene", action="append", help="only cases whose name contains this (forward: path tracing without derivatives); repeatable")
    p.add_argument("--skip", action="append", default=[], help="no cases whose name contains this; repeatable")
    p.add_argument("--seeds", type=int, default=16)
    p.add_argument("--pilot", type=int, default=4, help="seeds with which every setting is tried")
    p.add_argument("--seconds", type=float, default=30, help="wall time after which no more seeds are drawn")
    p.add_argument("--patience", type=float, default=300, help="wall time after which no further setting of a case is tried")
    p.add_argument("--timeout", type=int, default=900, help="seconds for one case")
    p.add_argument("--default", action="store_true", help="the default guiding only (minutes a gradient)")
    p.add_argument("--primal", action="store_true", help="only compare the losses")
    p.add_argument("--worker", help=argparse.SUPPRESS)
    a = p.parse_args()
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", llvm())
    if a.worker:
        for line in forward(a) if a.worker == "forward" else [measure(a.worker, a)]:
            print(json.dumps(line), flush=True)
        return
    missing = [m for m in ("mitsuba", "numpy") if importlib.util.find_spec(m) is None]
    if missing:
        sys.exit("%s has no module %s: pip install mitsuba numpy" % (sys.executable, " and no ".join(missing)))
    for path in sorted(glob.glob(os.path.join(a.folder, "*.json"))) + ["forward"]:
        row = {}
        if path != "forward":
            c = json.load(open(path))
            name = "%s / %s" % (c["scene"], c["param"])
            if (a.scene and not any(text in name for text in a.scene)) or any(text in name for text in a.skip):
                continue
            row = {"scene": c["scene"], "param": c["param"], "kind": c["kind"]}
            if why := refusal(c):
                print(json.dumps(dict(row, error=why)), flush=True)
                continue
        elif a.primal or a.default or (a.scene and "forward" not in a.scene):
            continue
        # A process for each case: its memory and its failures are its own. Compiled kernels are cached on disk.
        command = [sys.executable, os.path.abspath(__file__)] + sys.argv[1:] + ["--worker", path]
        try:
            done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=a.timeout)
        except subprocess.TimeoutExpired:
            print(json.dumps(dict(row, error="more than %d s" % a.timeout)), flush=True)
            continue
        lines = [l for l in done.stdout.splitlines() if l.startswith("{")]
        wanted = lines if path == "forward" else lines[-1:]
        print("\n".join(wanted) if wanted else json.dumps(dict(row, error="failed")), flush=True)


if __name__ == "__main__":
    main()
