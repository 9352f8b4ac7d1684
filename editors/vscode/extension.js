// Starts `dsl lsp` for *.dscene files; everything else is the server's.

const { spawnSync } = require("node:child_process");
const { Uri, ViewColumn, commands, window, workspace } = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function activate(context) {
  const changed = (event) => event.affectsConfiguration("dscene.path") && restart();
  context.subscriptions.push(workspace.onDidChangeConfiguration(changed));
  return start();
}

function start() {
  const command = workspace.getConfiguration("dscene").get("path") || "dsl";
  // Left to the client, a program that is missing is a connection that could not be created.
  const { error } = spawnSync(command, ["--version"], { timeout: 10000 });
  if (error) {
    explain(command, error);
    return undefined;
  }
  const server = { command, args: ["lsp"] };
  // The client would open any file as a text.
  const showDocument = async ({ uri }) => {
    await commands.executeCommand("vscode.open", Uri.parse(uri), { viewColumn: ViewColumn.Beside, preserveFocus: true });
    return { success: true };
  };
  const options = { documentSelector: [{ language: "dscene" }], middleware: { window: { showDocument } } };
  client = new LanguageClient("dscene", "dscene", server, options);
  return client.start();
}

async function explain(command, error) {
  const why = error.code === "ENOENT" ? "is not there" : `cannot be started (${error.message})`;
  const help = "Without it there are colours only. Put `dsl` on the path, or name it in the setting dscene.path.";
  const open = "Open the setting";
  if ((await window.showErrorMessage(`The program “${command}” ${why}. ${help}`, open)) === open) {
    commands.executeCommand("workbench.action.openSettings", "dscene.path");
  }
}

async function restart() {
  // One that never came up, because the setting named another program, cannot be stopped either.
  await Promise.resolve(deactivate()).catch(() => undefined);
  return start();
}

function deactivate() {
  const stopped = client && client.stop();
  client = undefined;
  return stopped;
}

module.exports = { activate, deactivate };
