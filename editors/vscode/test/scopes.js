// The packaged extension's grammar, and the scopes that it gives to a text.

const fs = require("node:fs");
const path = require("node:path");
const oniguruma = require("vscode-oniguruma");
const textmate = require("vscode-textmate");
const { contents } = require("./vsix");

// A little of Python, into which the extension brings its cells.
const PYTHON = {
  scopeName: "source.python",
  patterns: [{ match: "\\b(import|for|in)\\b", name: "keyword.control.python" }],
};

/// The grammar of a scope: the language's, or Python's with what the extension adds to it.
async function grammar(scope = "source.dscene") {
  const files = await contents();
  const { contributes } = JSON.parse(files.get("extension/package.json"));
  const given = new Map(contributes.grammars.map((grammar) => [grammar.scopeName, grammar]));
  const into = (name) => contributes.grammars.filter((grammar) => grammar.injectTo?.includes(name));
  const read = (name) => {
    const file = path.posix.join("extension", given.get(name).path);
    return textmate.parseRawGrammar(files.get(file).toString("utf8"), file);
  };
  const wasm = fs.readFileSync(path.join(path.dirname(require.resolve("vscode-oniguruma")), "onig.wasm"));
  await oniguruma.loadWASM(wasm);
  const registry = new textmate.Registry({
    onigLib: Promise.resolve({
      createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
      createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: async (name) => (name === PYTHON.scopeName ? PYTHON : read(name)),
    getInjections: (name) => into(name).map((grammar) => grammar.scopeName),
  });
  return registry.loadGrammar(scope);
}

/// For each line its tokens: `{ start, end, text, scopes }`, the innermost scope last, without the language's own.
function scopes(grammar, text) {
  let state = textmate.INITIAL;
  return text.split(/\r?\n/).map((line) => {
    const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
    state = ruleStack;
    return tokens.map((token) => ({
      start: token.startIndex,
      end: Math.min(token.endIndex, line.length),
      text: line.slice(token.startIndex, token.endIndex),
      scopes: token.scopes.slice(1),
    }));
  });
}

module.exports = { grammar, scopes };
