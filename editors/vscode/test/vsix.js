// What is in the packaged extension, which `npm run package` writes.

const path = require("node:path");
const yauzl = require("yauzl");
const { name, version } = require("../package.json");

const file = path.join(__dirname, "..", `${name}-${version}.vsix`);

/// The packaged files by their names in the archive.
function contents() {
  return new Promise((resolve, reject) => {
    yauzl.open(file, { lazyEntries: true }, (error, archive) => {
      if (error) return reject(error);
      const found = new Map();
      archive.on("error", reject);
      archive.on("end", () => resolve(found));
      archive.on("entry", (entry) => {
        if (entry.fileName.endsWith("/")) return archive.readEntry();
        archive.openReadStream(entry, (error, stream) => {
          if (error) return reject(error);
          const parts = [];
          stream.on("error", reject);
          stream.on("data", (part) => parts.push(part));
          stream.on("end", () => {
            found.set(entry.fileName, Buffer.concat(parts));
            archive.readEntry();
          });
        });
      });
      archive.readEntry();
    });
  });
}

module.exports = { contents };
