// Starts `dsl lsp` for *.dscene files; everything else is the server's.

const { workspace } = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function activate() {
  const command = workspace.getConfiguration("dscene").get("path") || "dsl";
  const server = { command, args: ["lsp"] };
  const options = { documentSelector: [{ language: "dscene" }] };
  client = new LanguageClient("dscene", "dscene", server, options);
  return client.start();
}

function deactivate() {
  return client && client.stop();
}

module.exports = { activate, deactivate };
