// The page of `dsl watch` and `dsl run --live`: shows what the program tells, and tells it what to do.

import { dolly, orbit, pan } from "./view.js";

const $ = (id) => document.getElementById(id);

// ---- orders --------------------------------------------------------------------------------------------------------

// What the program is asked for and has not answered yet. When it ends, it stays until the page says goodbye, which is when this is none.
let unanswered = 0;
let ended = false;

function awaits(count) {
  unanswered += count;
  if (ended && unanswered === 0) events.close();
}

async function order(body) {
  const headers = { "Content-Type": "application/json" };
  awaits(1);
  try {
    await fetch("do", { method: "POST", headers, body: JSON.stringify(body) });
  } catch {
    say("no connection", true);
  }
  awaits(-1);
}

// Sends the latest of what changes quickly, one at a time.
function latest(send) {
  let waiting = null;
  let busy = false;
  const next = async () => {
    if (busy || waiting === null) return;
    busy = true;
    const value = waiting;
    waiting = null;
    await send(value);
    busy = false;
    next();
  };
  return (value) => {
    waiting = value;
    next();
  };
}

// ---- what is told --------------------------------------------------------------------------------------------------

let isRun = false;
let phase = "";

function say(text, bad = false) {
  $("phase").textContent = text;
  $("phase").classList.toggle("bad", bad);
}

const heard = {
  program({ title, run }) {
    isRun = run;
    $("title").textContent = title;
    document.title = `${title} · dscene`;
    buttons();
  },
  phase(now) {
    phase = now;
    say(now === "wrong" ? "the script is wrong" : now, now === "wrong" || now === "failed");
    buttons();
  },
  picture: showPicture,
  derivative: showDerivative,
  camera: showCamera,
  params: showParams,
  diagnostics: showDiagnostics,
  optimizations: showOptimizations,
  optimization: showOptimization,
  log(lines) {
    $("output").hidden = lines.length === 0;
    const log = $("log");
    const atEnd = log.scrollHeight - log.scrollTop - log.clientHeight < 40;
    log.textContent = lines.join("\n");
    if (atEnd) log.scrollTop = log.scrollHeight;
  },
};

const events = new EventSource("events");
for (const [topic, hear] of Object.entries(heard)) {
  events.addEventListener(topic, (event) => hear(JSON.parse(event.data)));
}
events.addEventListener("end", () => {
  ended = true;
  awaits(0);
});
events.onerror = () => say("no connection", true);
events.onopen = () => phase && heard.phase(phase);

// ---- pictures ------------------------------------------------------------------------------------------------------

// An image that always shows the newest of a series, and loads one at a time.
function series(image, path) {
  let wanted = 0;
  let loading = 0;
  const load = () => {
    if (loading || !wanted) return;
    loading = wanted;
    wanted = 0;
    awaits(1);
    image.src = `${path}?${loading}`;
  };
  const done = () => {
    loading = 0;
    load();
    awaits(-1);
  };
  image.addEventListener("load", done);
  image.addEventListener("error", done);
  return (id) => {
    wanted = id;
    load();
  };
}

const loadPicture = series($("picture"), "picture");
const loadDerivative = series($("derivative"), "derivative");
let film = [256, 256];

const samples = (n) => `${n} ${n === 1 ? "sample" : "samples"} a pixel`;

function showPicture({ id, view, width, height, spp, of, exposure }) {
  loadPicture(id);
  if (document.activeElement !== $("exposure")) showStops(exposure);
  $("facts").textContent = `${width} × ${height}, ${samples(spp)}${spp < of ? ` of ${of}` : ""}`;
  $("picture").classList.toggle("coarse", width < film[0] || width < 300);
  if (view >= sentView) seen();
}

function showDerivative(told) {
  $("change").hidden = told === null;
  for (const button of document.querySelectorAll("[data-of]")) {
    const pressed = told !== null && button.dataset.of === `${told.param} ${told.element}`;
    button.setAttribute("aria-pressed", String(pressed));
  }
  if (told === null) return;
  loadDerivative(told.id);
  const element = label(shapes.get(told.param) ?? [], told.element);
  $("change-title").textContent = `∂ picture / ∂ ${told.param}${element}, ${samples(told.spp)}`;
  $("least").textContent = told.limit > 0 ? `−${number(told.limit)}` : "";
  $("most").textContent = told.limit > 0 ? `+${number(told.limit)}` : "0 everywhere";
}

$("close-change").addEventListener("click", () => order({ do: "derivative", name: null, element: 0 }));

function showStops(stops) {
  $("exposure").value = stops;
  $("stops").value = `${stops > 0 ? "+" : ""}${stops}`;
}

const expose = latest((stops) => order({ do: "exposure", stops }));
$("exposure").addEventListener("input", (event) => {
  const stops = Number(event.target.value);
  showStops(stops);
  expose(stops);
});

// ---- the camera ----------------------------------------------------------------------------------------------------

let pose = null;
let movable = false;
// Views are sent one at a time: the next when the picture of the last is there.
let sentView = 0;
let viewWaits = false;
let viewPending = false;
let viewTimer = 0;

function showCamera(told) {
  document.body.classList.toggle("blind", told === null);
  $("unseen").hidden = told !== null;
  if (told === null) return;
  film = told.film;
  movable = told.movable;
  $("frame").classList.toggle("fixed", !movable);
  if (pointers.size === 0 && !viewPending) pose = told.pose;
  $("pose").hidden = !told.line;
  $("line").textContent = told.line ?? "";
  $("back").disabled = !told.moved;
  const [width, height] = film;
  document.documentElement.style.setProperty("--ratio", width / height);
  options($("camera"), told.names, told.name);
  $("cameras").hidden = told.names.length < 2;
}

function options(select, names, chosen) {
  if (select.options.length !== names.length || names.some((name, i) => select.options[i].text !== name)) {
    select.replaceChildren(...names.map((name, i) => new Option(name, String(i))));
  }
  if (chosen !== undefined) select.selectedIndex = names.indexOf(chosen);
}

$("camera").addEventListener("change", (event) => {
  order({ do: "camera", name: event.target.selectedOptions[0].text });
});

function seen() {
  clearTimeout(viewTimer);
  viewWaits = false;
  if (viewPending) sendView();
}

function sendView() {
  viewPending = true;
  if (viewWaits) return;
  viewPending = false;
  viewWaits = true;
  sentView += 1;
  order({ do: "view", number: sentView, pose });
  viewTimer = setTimeout(seen, 1000);
}

function move(next) {
  if (!movable || !pose) return;
  pose = next(pose);
  sendView();
}

$("back").addEventListener("click", () => {
  pose = null;
  sendView();
});

$("copy").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText($("line").textContent);
    $("copy").textContent = "Copied";
  } catch {
    getSelection().selectAllChildren($("line"));
    $("copy").textContent = "Selected";
  }
  setTimeout(() => ($("copy").textContent = "Copy"), 1500);
});

const frame = $("frame");
const pointers = new Map();

frame.addEventListener("pointerdown", (event) => {
  if (!movable) return;
  frame.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});
frame.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const size = frame.clientHeight || 1;
  const [dx, dy] = [(now[0] - before[0]) / size, (now[1] - before[1]) / size];
  if (pointers.size >= 2) {
    const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
    move((p) => dolly(pan(p, -dx / 2, dy / 2), apart(before) / apart(now)));
  } else if (event.shiftKey || event.buttons & 6) {
    move((p) => pan(p, -dx, dy));
  } else {
    move((p) => orbit(p, dx * Math.PI, dy * Math.PI));
  }
  pointers.set(event.pointerId, now);
});
for (const end of ["pointerup", "pointercancel"]) {
  frame.addEventListener(end, (event) => pointers.delete(event.pointerId));
}
frame.addEventListener("contextmenu", (event) => event.preventDefault());
frame.addEventListener(
  "wheel",
  (event) => {
    if (!movable) return;
    event.preventDefault();
    move((p) => dolly(p, Math.exp(Math.max(-50, Math.min(50, event.deltaY)) * 0.003)));
  },
  { passive: false },
);
const KEYS = {
  ArrowLeft: (p) => orbit(p, -0.1, 0),
  ArrowRight: (p) => orbit(p, 0.1, 0),
  ArrowUp: (p) => orbit(p, 0, -0.1),
  ArrowDown: (p) => orbit(p, 0, 0.1),
  "+": (p) => dolly(p, 0.9),
  "-": (p) => dolly(p, 1 / 0.9),
};
frame.addEventListener("keydown", (event) => {
  const next = KEYS[event.key];
  if (!next || !movable) return;
  event.preventDefault();
  move(next);
});

// ---- params --------------------------------------------------------------------------------------------------------

const number = (x) => (x === 0 ? "0" : Number(x.toPrecision(5)).toString());

// `[2].y`
function label(shape, index) {
  const at = [];
  let rest = index;
  for (const n of [...shape].reverse()) {
    at.unshift(rest % n);
    rest = Math.floor(rest / n);
  }
  const last = shape.at(-1);
  const letter = last >= 2 && last <= 4 ? `.${"xyzw"[at.pop()]}` : "";
  return at.map((i) => `[${i}]`).join("") + letter;
}

const toLinear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const toEncoded = (c) => (c <= 0.0031308 ? c * 12.92 : 1.055 * c ** (1 / 2.4) - 0.055);
const byte = (c) => Math.round(255 * Math.min(1, Math.max(0, c)));
const hex = (rgb) => `#${rgb.map((c) => byte(toEncoded(Math.max(0, c))).toString(16).padStart(2, "0")).join("")}`;
const fromHex = (text) => [1, 3, 5].map((i) => toLinear(parseInt(text.slice(i, i + 2), 16) / 255));

// By name: what shows a param, and its shape.
const shownParams = new Map();
const shapes = new Map();
let layout = "";

function element(tag, classes, text) {
  const made = document.createElement(tag);
  made.className = classes;
  if (text !== undefined) made.textContent = text;
  return made;
}

function showParams(params) {
  $("unknowns").hidden = params.length === 0;
  const now = JSON.stringify(params.map(({ name, shape, type, values }) => [name, shape, type, values !== null]));
  if (layout !== now) {
    layout = now;
    shownParams.clear();
    shapes.clear();
    for (const { name, shape } of params) shapes.set(name, shape);
    $("params").replaceChildren(...params.map(makeParam));
  }
  for (const param of params) shownParams.get(param.name)?.update(param);
}

function derivativeButton(param, index) {
  const button = element("button", "", "∂");
  button.type = "button";
  button.dataset.of = `${param.name} ${index}`;
  button.title = `The derivative of the picture with respect to ${param.name}${label(param.shape, index)}`;
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => {
    const pressed = button.getAttribute("aria-pressed") === "true";
    order({ do: "derivative", name: pressed ? null : param.name, element: index });
  });
  return button;
}

function makeParam(param) {
  const box = element("div", "param");
  box.dataset.param = param.name;
  const head = element("div", "head");
  head.append(element("span", "name", param.name));
  head.append(element("span", "quiet", `${param.type}${param.frozen ? ", frozen" : ""}`));
  box.append(head);
  let values = param.values;
  const send = latest((all) => order({ do: "set", name: param.name, values: all }));
  const set = (index, x) => {
    if (!Number.isFinite(x)) return;
    values = values.with(index, x);
    send(values);
  };
  const rows = [];
  let color = null;
  let whole = null;
  if (values !== null) {
    if (param.color) {
      color = element("input", "");
      color.type = "color";
      color.setAttribute("aria-label", `${param.name}, as a colour`);
      color.addEventListener("input", () => {
        const brightest = Math.max(1, ...values);
        values = fromHex(color.value).map((c) => c * brightest);
        send(values);
      });
      head.append(color);
    }
    values.forEach((value, index) => rows.push(makeElement(param, index, set)));
    box.append(...rows.map((row) => row.box));
  } else {
    whole = element("p", "whole", param.text);
    box.append(whole);
    box.append(element("p", "quiet", param.unset));
    const pick = element("div", "head pick");
    // A rotation turns about three axes; a large param has more numbers than there is room for buttons.
    const count = Math.min(param.elements, 3);
    if (count < param.elements) pick.append(element("span", "quiet", `first ${count} of ${param.elements}:`));
    for (let index = 0; index < count; index += 1) {
      const one = element("label", "head", param.elements === 3 ? "xyz"[index] : label(param.shape, index));
      one.append(derivativeButton(param, index));
      pick.append(one);
    }
    box.append(pick);
  }
  shownParams.set(param.name, {
    update(now) {
      if (whole) whole.textContent = now.text;
      if (now.values === null) return;
      values = now.values;
      rows.forEach((row, index) => row.update(now.values[index]));
      if (color && document.activeElement !== color) {
        const brightest = Math.max(1, ...now.values);
        color.value = hex(now.values.map((c) => c / brightest));
      }
      if (color) color.disabled = isRun;
    },
  });
  return box;
}

function makeElement(param, index, set) {
  const box = element("div", "element");
  const name = `${param.name}${label(param.shape, index)}`;
  box.append(element("span", "label", label(param.shape, index) || (param.angle ? "deg" : "")));
  const [range, field] = ["range", "number"].map((type) => {
    const input = element("input", "");
    input.type = type;
    input.step = "any";
    input.setAttribute("aria-label", name);
    input.addEventListener(type === "range" ? "input" : "change", () => set(index, input.valueAsNumber));
    box.append(input);
    return input;
  });
  box.append(derivativeButton(param, index));
  const value = param.values[index];
  const reach = param.angle ? 180 : Math.max(1, 2 * Math.abs(value));
  // A slider has two ends, also where bounds leave a side open.
  const [low, high] = [param.low?.[index] ?? null, param.high?.[index] ?? null];
  range.min = low ?? Math.min(value, high ?? value) - reach;
  range.max = high ?? Math.max(value, low ?? value) + reach;
  if (low !== null) field.min = low;
  if (high !== null) field.max = high;
  return {
    box,
    update(now) {
      range.disabled = field.disabled = isRun;
      if (!range.matches(":active")) {
        if (low === null && now < range.min) range.min = now - reach;
        if (high === null && now > range.max) range.max = now + reach;
        range.value = now;
      }
      if (document.activeElement !== field) field.value = number(now);
    },
  };
}

$("reset").addEventListener("click", () => order({ do: "reset" }));

// ---- what is wrong -------------------------------------------------------------------------------------------------

function showDiagnostics(all) {
  $("wrong").hidden = all.length === 0;
  const shown = all.map(({ severity, message, labels, text }) => {
    const box = element("div", `diagnostic ${severity}`);
    const place = labels[0] ? `${labels[0].file}:${labels[0].start.line}:${labels[0].start.column}: ` : "";
    box.append(element("h3", "", `${place}${message}`), element("pre", "", text));
    return box;
  });
  $("wrong").replaceChildren(...shown);
}

// ---- optimisation --------------------------------------------------------------------------------------------------

function buttons() {
  const running = phase === "optimising";
  const paused = phase === "paused";
  const none = $("optimizations").options.length === 0;
  $("start").hidden = isRun;
  $("start").disabled = running || paused || none || phase === "wrong";
  $("pause").textContent = paused ? "Resume" : "Pause";
  $("pause").disabled = !running && !paused;
  $("step").disabled = !running && !paused;
  $("stop").disabled = isRun ? ["finished", "failed", "stopped"].includes(phase) : !running && !paused;
  $("reset").hidden = isRun;
  $("progress").hidden = none && !isRun;
}

function showOptimizations(names) {
  options($("optimizations"), names);
  $("which").hidden = names.length < 2;
  buttons();
}

function duration(seconds) {
  if (seconds < 60) return `${Math.ceil(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

function showOptimization({ name, done, total, seconds_per_step, loss, losses }) {
  $("progress").hidden = false;
  const rest = done < total ? `, ${duration((total - done) * seconds_per_step)} left` : "";
  $("steps").textContent =
    `step ${done} of ${total} of ${name}: ${loss === null ? "not finite" : number(loss)}, ${Number(seconds_per_step.toPrecision(2))} s a step${rest}`;
  drawCurve(losses.filter(([, x]) => x !== null));
}

// On a logarithmic axis where the loss falls by more than one order of magnitude.
function drawCurve(losses) {
  // `hidden` is a property of HTML elements only.
  $("curve").toggleAttribute("hidden", losses.length < 2);
  if (losses.length < 2) return;
  const values = losses.map(([, x]) => x);
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const isLog = least > 0 && most / least > 10;
  const place = isLog ? Math.log : (x) => x;
  const [low, high] = [place(least), place(most)];
  const [first, last] = [losses[0][0], losses.at(-1)[0]];
  const at = ([step, x]) => {
    const right = 4 + 392 * ((step - first) / (last - first));
    const down = 24 + 112 * (1 - (place(x) - low) / (high - low || 1));
    return `${right.toFixed(1)},${down.toFixed(1)}`;
  };
  $("losses").setAttribute("points", losses.map(at).join(" "));
  $("top").textContent = `${number(most)}${isLog ? " (logarithmic)" : ""}`;
  $("bottom").textContent = number(least);
  $("last").textContent = `step ${last + 1}`;
}

$("start").addEventListener("click", () => order({ do: "start", index: Math.max(0, $("optimizations").selectedIndex) }));
$("pause").addEventListener("click", () => order({ do: phase === "paused" ? "resume" : "pause" }));
$("step").addEventListener("click", () => order({ do: "step" }));
$("stop").addEventListener("click", () => order({ do: "stop" }));
