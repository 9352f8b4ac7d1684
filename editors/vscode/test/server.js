// A client of `dsl lsp` that asks for semantic tokens.

const { spawn } = require("node:child_process");
const path = require("node:path");
const { pathToFileURL } = require("node:url");

// The program under test: that of the last `cargo build --release`, unless `DSL` names another one.
const program = process.env.DSL || path.join(__dirname, "../../../target/release/dsl");

class Server {
  constructor() {
    this.child = spawn(program, ["lsp"], { stdio: ["pipe", "pipe", "inherit"] });
    this.input = Buffer.alloc(0);
    this.waiting = new Map();
    this.asked = 0;
    this.child.on("error", (error) => this.fail(new Error(`${program} does not start: ${error.message}`)));
    this.child.on("exit", (code) => this.fail(new Error(`${program} ended with ${code}`)));
    this.child.stdout.on("data", (data) => this.read(data));
  }

  fail(error) {
    for (const { reject } of this.waiting.values()) reject(error);
  }

  read(data) {
    this.input = Buffer.concat([this.input, data]);
    for (;;) {
      const head = this.input.indexOf("\r\n\r\n");
      if (head < 0) return;
      const length = Number(/Content-Length: (\d+)/.exec(this.input.toString("latin1", 0, head))[1]);
      const end = head + 4 + length;
      if (this.input.length < end) return;
      const message = JSON.parse(this.input.toString("utf8", head + 4, end));
      this.input = this.input.subarray(end);
      const waiting = this.waiting.get(message.id);
      if (message.method || !waiting) continue;
      this.waiting.delete(message.id);
      if (message.error) waiting.reject(new Error(message.error.message));
      else waiting.resolve(message.result);
    }
  }

  send(message) {
    const body = JSON.stringify({ jsonrpc: "2.0", ...message });
    this.child.stdin.write(`Content-Length: ${Buffer.byteLength(body)}\r\n\r\n${body}`);
  }

  request(method, params) {
    const id = ++this.asked;
    this.send({ id, method, params });
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  async start() {
    const { capabilities } = await this.request("initialize", { capabilities: {} });
    this.types = capabilities.semanticTokensProvider.legend.tokenTypes;
    this.send({ method: "initialized", params: {} });
  }

  /// The tokens of a text: `{ line, start, end, type }`.
  async tokens(file, text) {
    const uri = pathToFileURL(file).href;
    this.send({
      method: "textDocument/didOpen",
      params: { textDocument: { uri, languageId: "dscene", version: 1, text } },
    });
    const { data } = await this.request("textDocument/semanticTokens/full", { textDocument: { uri } });
    this.send({ method: "textDocument/didClose", params: { textDocument: { uri } } });
    const found = [];
    let [line, start] = [0, 0];
    for (let i = 0; i < data.length; i += 5) {
      const [lines, columns, length, type] = data.slice(i, i + 4);
      start = lines > 0 ? columns : start + columns;
      line += lines;
      found.push({ line, start, end: start + length, type: this.types[type] });
    }
    return found;
  }

  async end() {
    await this.request("shutdown", null);
    this.child.removeAllListeners("exit");
    this.send({ method: "exit" });
  }
}

module.exports = { Server };
