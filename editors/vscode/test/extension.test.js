// The packaged extension, as an editor gets it. Run by `npm test`, which packages it first.

const assert = require("node:assert");
const fs = require("node:fs");
const Module = require("node:module");
const os = require("node:os");
const path = require("node:path");
const test = require("node:test");
const { grammar, scopes } = require("./scopes");
const { Server } = require("./server");
const { contents } = require("./vsix");

const root = path.join(__dirname, "../../..");

test("the package holds what it names, and starts `dsl lsp`", async () => {
  const files = await contents();
  const folder = fs.mkdtempSync(path.join(os.tmpdir(), "dscene-vsix-"));
  for (const [name, bytes] of files) {
    fs.mkdirSync(path.dirname(path.join(folder, name)), { recursive: true });
    fs.writeFileSync(path.join(folder, name), bytes);
  }
  const extension = path.join(folder, "extension");
  const { main, contributes } = JSON.parse(files.get("extension/package.json"));
  const named = [
    contributes.languages[0].configuration,
    contributes.grammars[0].path,
    contributes.snippets[0].path,
  ];
  for (const name of named) JSON.parse(fs.readFileSync(path.join(extension, name)));
  const strays = [...files.keys()].filter((name) => name.startsWith("extension/test/"));
  assert.deepStrictEqual(strays, [], "tests stay out");

  // The editor and its client are stood in for; what the extension asks of them is what it is about.
  const started = [];
  let stops = true;
  class LanguageClient {
    constructor(...all) {
      this.all = all;
    }
    start() {
      started.push(this.all);
    }
    stop() {
      if (!stops) return Promise.reject(new Error("it does not run"));
      started.push("stopped");
      return Promise.resolve();
    }
  }
  // Any program that is there will do, and one that is not.
  let program = process.execPath;
  let changed;
  const messages = [];
  const opened = [];
  const settings = { get: (name) => (name === "path" ? program : undefined) };
  const standIns = {
    vscode: {
      Uri: { parse: (uri) => `parsed ${uri}` },
      ViewColumn: { Beside: -2 },
      commands: { executeCommand: (...all) => opened.push(all) },
      window: {
        showErrorMessage: async (message, button) => {
          messages.push(message);
          return button;
        },
      },
      workspace: {
        getConfiguration: (name) => (name === "dscene" ? settings : undefined),
        onDidChangeConfiguration: (listener) => {
          changed = listener;
          return { dispose() {} };
        },
      },
    },
    "vscode-languageclient/node": { LanguageClient },
  };
  const load = Module._load;
  Module._load = (name, ...rest) => standIns[name] ?? load(name, ...rest);
  try {
    const { activate, deactivate } = require(path.join(extension, main));
    const context = { subscriptions: [] };
    program = "/opt/dsl";
    await activate(context);
    assert.strictEqual(context.subscriptions.length, 1);
    assert.deepStrictEqual(started, []);
    assert.match(messages.join(), /“\/opt\/dsl” is not there.*dscene\.path/);
    await new Promise((soon) => setImmediate(soon));
    assert.deepStrictEqual(opened, [["workbench.action.openSettings", "dscene.path"]]);
    // Named rightly, it is started without the window being opened anew.
    program = process.execPath;
    const named = { affectsConfiguration: (name) => name === "dscene.path" };
    await changed(named);
    // A server that has not come up cannot be stopped, and is no reason to start no other.
    stops = false;
    await changed(named);
    assert.strictEqual(started.length, 2);
    started.shift();
    stops = true;
    deactivate();
  } finally {
    Module._load = load;
  }
  const [[, , server, options], last] = started;
  assert.deepStrictEqual(server, { command: process.execPath, args: ["lsp"] });
  assert.deepStrictEqual(options.documentSelector, [{ language: "dscene" }]);
  assert.strictEqual(last, "stopped");
  // Pictures are opened as what they are.
  opened.length = 0;
  assert.deepStrictEqual(await options.middleware.window.showDocument({ uri: "file:///eye.png" }), { success: true });
  assert.deepStrictEqual(opened[0].slice(0, 2), ["vscode.open", "parsed file:///eye.png"]);
  // The client itself is in the package.
  assert.ok(require.resolve("vscode-languageclient/node", { paths: [extension] }).startsWith(fs.realpathSync(folder)));
  fs.rmSync(folder, { recursive: true });
});

// A text, a word of it, and the scope that it has.
const SCOPES = [
  ["/// Says.", "/// Says.", "comment.line.documentation"],
  ["// says", "// says", "comment.line.double-slash"],
  ["//// a row", "//// a row", "comment.line.double-slash"],
  ["/* a /* b */ let */", " let ", "comment.block"],
  ['let a = "say // {x:.3} {{}} \\n"', "say // ", "string.quoted.double"],
  ['let a = "say // {x:.3} {{}} \\n"', "x", "meta.embedded"],
  ['let a = "say // {x:.3} {{}} \\n"', "{{", "constant.character.escape"],
  ['let a = "say // {x:.3} {{}} \\n"', "\\n", "constant.character.escape"],
  ["let a = 1_000.5e-3cm", "1_000.5e-3", "constant.numeric"],
  ["let a = 1_000.5e-3cm", "cm", "keyword.other.unit"],
  ["let a = 30%", "%", "keyword.other.unit"],
  ["let a = #ff8000", "#ff8000", "constant.other.color"],
  ["let a = true", "true", "constant.language"],
  ["let a = b", "let", "keyword.declaration"],
  ["let a = b", "a", "variable.other.declaration"],
  ["param glow = 1 in 0..1", "param", "keyword.declaration"],
  ["param glow = 1 in 0..1", "in", "keyword.control"],
  ["param glow = 1 in 0..1", "..", "keyword.operator"],
  ["loss l = mse(a, b)", "loss", "keyword.declaration"],
  ["loss l = mse(a, b)", "mse", "entity.name.function.call"],
  ["camera eye { fov: 45deg }", "camera", "keyword.declaration"],
  ["camera eye { fov: 45deg }", "fov", "variable.parameter"],
  ["let a = eye.camera.loss", "camera", "variable.other.member"],
  ["let a = eye.camera.loss", "loss", "variable.other.member"],
  ["let a = { camera: 1, in: 2 }", "in", "variable.parameter"],
  ["native fn f(x: vec3 | image[n]): color", "native", "keyword.control"],
  ["native fn f(x: vec3 | image[n]): color", "fn", "keyword.declaration"],
  ["native fn f(x: vec3 | image[n]): color", "f", "entity.name.function"],
  ["native fn f(x: vec3 | image[n]): color", "vec3", "support.type"],
  ["native fn f(x: vec3 | image[n]): color", "image", "support.type"],
  ["native fn f(x: vec3 | image[n]): color", "color", "support.type"],
  ["let a: vec3[2] = f(spp: samples)", "vec3", "support.type"],
  ["let a: vec3[2] = f(spp: samples)", "spp", "variable.parameter"],
  ["fn f(g: (scalar) => vec3, v: { cam: camera }) = g", "scalar", "support.type"],
  ["fn f(g: (scalar) => vec3, v: { cam: camera }) = g", "camera", "support.type"],
  ["fn f(g: (image, mesh) => vec3) = g", "mesh", "support.type"],
  ["fn f(g: (image, mesh) => vec3) = g", "vec3", "support.type"],
  ["param size: scalar ~ normal(0, 1)", "scalar", "support.type"],
  ["let a = if b then c else not d", "then", "keyword.control"],
  ["let a = if b then c else not d", "not", "keyword.operator.word"],
  ["expect a ≈ b within 1%", "within", "keyword.operator.word"],
  ["expect a ≈ b within 1%", "≈", "keyword.operator"],
  ['test "it" { expect a }', "test", "keyword.declaration"],
  ["let test = 1", "test", "variable.other.declaration"],
  ["plot f(a) over b", "over", "keyword.control"],
  ["camera eye { over: 1, of: 2 }", "of", "variable.parameter"],
  ['save blob.mesh to "blob.obj"', "mesh", "variable.other.member"],
  ['save blob.mesh to "blob.obj"', "to", "keyword.control"],
  ["optimize l { stage one { steps: 3 } }", "stage", "keyword.declaration"],
  ["optimize l { every 5 { print a } }", "every", "keyword.control"],
];

test("each kind of token has its scope", async () => {
  const read = await grammar();
  for (const [text, word, scope] of SCOPES) {
    const tokens = scopes(read, text).flat();
    const token = tokens.find((t) => t.text === word || t.text.trim() === word);
    assert.ok(token, `no token \`${word}\` in ${text}: ${JSON.stringify(tokens)}`);
    const has = token.scopes.some((s) => s.startsWith(scope));
    assert.ok(has, `\`${word}\` in ${text} has ${token.scopes.join(" ")}, not ${scope}`);
  }
});

test("cells of notebooks that are scripts have the colours of scripts", async () => {
  const read = await grammar("source.python");
  const lines = scopes(read, "%%dscene bowl --seed 3\nparam x = 3 in 0..1\nloss l = x ^ 2\n\nprint l");
  const found = (line, word) => lines[line].find((token) => token.text.trim() === word)?.scopes ?? [];
  assert.ok(found(0, "%%dscene").includes("support.function.magic.dscene"));
  assert.ok(found(1, "param").includes("keyword.declaration.dscene"));
  assert.ok(found(1, "param").includes("meta.embedded.block.dscene"));
  assert.ok(found(4, "print").includes("keyword.control.dscene"), "a blank line is not the end");
  // Other cells are Python's.
  const other = scopes(read, "import dscene\nfor x in y:").flat();
  assert.deepStrictEqual(other.filter((token) => token.scopes.join().includes("dscene")), []);
  assert.ok(other.some((token) => token.scopes.includes("keyword.control.python")));
});

// What a scope and a semantic token have in common.
function family(scopes) {
  const inner = scopes.at(-1) ?? "";
  if (scopes.some((s) => s.startsWith("comment."))) return "comment";
  if (/^(keyword\.(control|declaration|operator\.word)|constant\.language)\./.test(inner)) return "keyword";
  if (/^(constant\.(numeric|other\.color)|keyword\.other\.unit)\./.test(inner)) return "number";
  if (inner.startsWith("support.type.")) return "type";
  if (/^(string|constant\.character\.escape|punctuation\.section\.embedded)/.test(inner)) return "string";
  return "name";
}

const FAMILIES = ["comment", "keyword", "number", "type", "string"];

function scripts(folder) {
  return fs.readdirSync(folder, { withFileTypes: true }).flatMap((entry) => {
    const file = path.join(folder, entry.name);
    if (entry.isDirectory()) return ["target", "node_modules", "runs", ".git"].includes(entry.name) ? [] : scripts(file);
    return entry.name.endsWith(".dscene") ? [file] : [];
  });
}

test("scopes are of the same kind as the language server's tokens, in all scripts", async () => {
  const read = await grammar();
  const server = new Server();
  await server.start();
  const differences = [];
  let compared = 0;
  for (const file of scripts(root)) {
    const text = fs.readFileSync(file, "utf8");
    const lines = scopes(read, text);
    for (const { line, start, end, type } of await server.tokens(file, text)) {
      const ours = FAMILIES.includes(type) ? type : "name";
      for (const token of lines[line].filter((t) => t.start < end && start < t.end)) {
        compared++;
        const theirs = family(token.scopes);
        if (ours !== theirs) {
          differences.push(`${path.relative(root, file)}:${line + 1}: \`${token.text}\` is ${type}, and ${token.scopes.join(" ")}`);
        }
      }
    }
  }
  await server.end();
  assert.deepStrictEqual(differences.slice(0, 40), [], `${differences.length} differences`);
  assert.ok(compared > 10000, `${compared} compared`);
});
