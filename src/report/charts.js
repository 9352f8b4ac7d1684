"use strict";
// Elements, numbers as text, and line charts: what all pages share.

const SVG = "http://www.w3.org/2000/svg";

/// An element with attributes and children; text becomes text, never markup.
function make(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

function draw(name, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, name), attributes, children);
}

function filled(element, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children.flat(9).filter((child) => child !== null && child !== undefined));
  return element;
}

/// JSON has no infinities: logs write them as text.
function number(x) {
  if (typeof x === "number") return x;
  return x === "inf" ? Infinity : x === "-inf" ? -Infinity : NaN;
}

const numbers = (list) => list.map(number);

/// With `digits` significant digits, no trailing zeros, and a true minus sign.
function shown(x, digits = 4) {
  if (!Number.isFinite(x)) return Number.isNaN(x) ? "–" : x > 0 ? "∞" : "−∞";
  if (x === 0) return "0";
  const size = Math.abs(x);
  let text;
  if (size >= 1e5 || size < 1e-3) {
    const [mantissa, exponent] = x.toExponential(digits - 1).split("e");
    text = trimmed(mantissa) + "e" + Number(exponent);
  } else {
    text = String(Number(x.toPrecision(digits)));
  }
  return text.replace("-", "−").replace("e-", "e−");
}

const trimmed = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);

function seconds(s) {
  if (!Number.isFinite(s)) return "–";
  if (s === 0) return "0 s";
  if (s < 1e-3) return shown(s * 1e6, 2) + " µs";
  if (s < 1) return shown(s * 1e3, 3) + " ms";
  if (s < 60) return shown(s, 3) + " s";
  const minutes = Math.floor(s / 60);
  if (minutes < 60) return `${minutes} min ${Math.floor(s % 60)} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

function bytes(n) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let at = 0;
  while (n >= 1000 && at + 1 < units.length) (n /= 1000), at++;
  return shown(n, 3) + " " + units[at];
}

/// With blanks between thousands.
const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u202f");

const DASHES = ["", "6 3", "2 2", "8 3 2 3"];
const colour = (at) => `var(--c${at % 8})`;
const dash = (at) => DASHES[Math.floor(at / 8) % DASHES.length];

/// Steps of a linear axis, at 1, 2 or 5 times a power of ten.
function linearTicks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999) || raw;
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + step * 1e-9; at++) found.push(at * step);
  return found;
}

/// Powers of ten; where there are few of them, 2 and 5 times those as well.
function logTicks(low, high, most) {
  const [from, to] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
  const decades = to - from;
  const every = Math.max(1, Math.ceil(decades / most));
  const within = decades <= 1 ? [1, 2, 3, 5, 7] : decades <= 2 ? [1, 2, 5] : [1];
  const found = [];
  for (let decade = from; decade <= to; decade += every) found.push(...within.map((m) => m * 10 ** decade));
  return found.filter((x) => x >= low * 0.9999 && x <= high * 1.0001);
}

/// The range of finite numbers, with a margin.
function range(values, log) {
  let [low, high] = [Infinity, -Infinity];
  for (const x of values) {
    if (Number.isFinite(x) && (!log || x > 0)) {
      low = Math.min(low, x);
      high = Math.max(high, x);
    }
  }
  if (low > high) return log ? [0.1, 1] : [0, 1];
  if (log) {
    if (high / low < 1.05) return [low / 1.3, high * 1.3];
    const margin = (high / low) ** 0.05;
    return [low / margin, high * margin];
  }
  const margin = high > low ? (high - low) * 0.06 : Math.abs(high) * 0.1 || 0.5;
  return [low - margin, high + margin];
}

/// A chart of curves.
///   series: [{ name, x, y, low?, high?, colour?, dash?, width?, group? }], of equal length, sorted by x; those of a group share a legend.
///   x, y: { label, log?, text?, from?, zero?, whole? }: what the axis measures, how its numbers are written, where it begins.
///   marks: [{ x, text }], upright lines. bounds: [{ y, colour }], level ones. height in pixels.
function chart({ title, series: given, x, y, marks = [], bounds = [], height = 260, switchable = false }) {
  const series = given.filter((s) => s.y.some(Number.isFinite));
  const box = make("div", { class: "chart", role: "img", "aria-label": title || y.label });
  const tip = make("div", { class: "tip", hidden: "" });
  const hidden = new Set();
  const groups = [...new Map(series.map((s) => [s.group ?? s.name, s])).entries()];
  let log = Boolean(y.log);
  let drawn = null;

  function redraw() {
    const width = box.clientWidth;
    if (!width) return;
    const visible = series.filter((s) => !hidden.has(s.group ?? s.name));
    const values = visible.flatMap((s) => [s.y, log ? [] : s.low || [], log ? [] : s.high || []]).flat();
    const level = bounds.filter((b) => Number.isFinite(b.y));
    const ends = y.zero && !log ? [0] : level.filter((b) => near(b.y, values)).map((b) => b.y);
    let [low, high] = range(values.concat(ends), log);
    if (y.zero && !log) low = 0;
    const [right, top, bottom] = [12, marks.some((m) => m.text) ? 20 : 10, 40];
    const most = (height - top - bottom) / 40;
    let ticks = log ? logTicks(low, high, most) : [];
    // Within less than a decade a logarithm has hardly any round numbers but those of a linear axis.
    if (ticks.length < 3) ticks = linearTicks(low, high, most).filter((v) => !log || v > 0);
    // As many digits as tell neighbours apart.
    const apart = Math.abs(ticks[1] - ticks[0]) || 1;
    const digits = log ? 4 : Math.min(10, Math.max(3, Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / apart)) + 1));
    const write = y.text || ((v) => shown(v, digits));
    const left = 30 + 6.5 * Math.max(3, ...ticks.map((v) => write(v).length));
    const inner = { width: width - left - right, height: height - top - bottom };
    let [from, to] = [x.from ?? Infinity, -Infinity];
    for (const s of visible) if (s.x.length) (from = Math.min(from, s.x[0])), (to = Math.max(to, s.x[s.x.length - 1]));
    if (from > to) [from, to] = [0, 1];
    if (from === to) to = from + 1;
    const px = (v) => left + ((v - from) / (to - from)) * inner.width;
    const share = log ? (v) => Math.log(v / low) / Math.log(high / low) : (v) => (v - low) / (high - low);
    const py = (v) => top + inner.height * (1 - Math.min(1.02, Math.max(-0.02, share(v))));

    const svg = draw("svg", { viewBox: `0 0 ${width} ${height}`, height });
    for (const v of ticks) {
      svg.append(draw("line", { class: "grid", x1: left, x2: left + inner.width, y1: py(v), y2: py(v) }));
      svg.append(draw("text", { x: left - 6, y: py(v) + 4, "text-anchor": "end" }, write(v)));
    }
    for (const v of linearTicks(from, to, inner.width / 80).filter((v) => !x.whole || Number.isInteger(v))) {
      svg.append(draw("line", { class: "grid", x1: px(v), x2: px(v), y1: top, y2: top + inner.height }));
      svg.append(draw("text", { x: px(v), y: height - 22, "text-anchor": "middle" }, (x.text || ((t) => shown(t, 6)))(Number(v.toPrecision(9)))));
    }
    svg.append(draw("rect", { class: "frame", x: left, y: top, width: inner.width, height: inner.height }));
    svg.append(draw("text", { class: "label", x: left + inner.width / 2, y: height - 4, "text-anchor": "middle" }, x.label));
    const middle = top + inner.height / 2;
    svg.append(draw("text", { class: "label", x: 11, y: middle, "text-anchor": "middle", transform: `rotate(-90 11 ${middle})` }, y.label));
    for (const mark of marks.filter((m) => m.x >= from && m.x <= to)) {
      svg.append(draw("line", { class: "mark", x1: px(mark.x), x2: px(mark.x), y1: top, y2: top + inner.height }));
      const late = px(mark.x) > left + inner.width * 0.8;
      const at = { x: px(mark.x) + (late ? -4 : 4), y: 13, "text-anchor": late ? "end" : "start" };
      if (mark.text) svg.append(draw("text", at, mark.text));
    }
    for (const bound of level) {
      if (bound.y < low || bound.y > high) continue;
      const at = { x1: left, x2: left + inner.width, y1: py(bound.y), y2: py(bound.y) };
      svg.append(draw("line", { class: "bound", stroke: bound.colour || "var(--soft)", ...at }));
    }
    const usable = (v) => Number.isFinite(v) && (!log || v > 0);
    for (const s of visible) {
      if (s.low) {
        // Below nothing a logarithm has no place: the band ends at the frame.
        const edge = (v) => (usable(v) ? py(v) : log ? top + inner.height : NaN);
        const known = s.x.map((_, i) => i).filter((i) => Number.isFinite(edge(s.low[i])) && usable(s.high[i]));
        const there = known.map((i) => `${px(s.x[i]).toFixed(1)},${py(s.high[i]).toFixed(1)}`);
        const back = known.reverse().map((i) => `${px(s.x[i]).toFixed(1)},${edge(s.low[i]).toFixed(1)}`);
        svg.append(draw("polygon", { class: "band", fill: s.colour, points: there.concat(back).join(" ") }));
      }
    }
    for (const s of visible) {
      let path = "";
      let pen = "M";
      s.y.forEach((v, i) => {
        if (usable(v)) path += `${pen}${px(s.x[i]).toFixed(1)} ${py(v).toFixed(1)}`;
        pen = usable(v) ? "L" : "M";
      });
      // A single point is seen, too.
      if (path && !path.includes("L")) path += "h0.01";
      const style = { stroke: s.colour, "stroke-dasharray": s.dash || null, "stroke-width": s.width || null, "stroke-linecap": "round" };
      svg.append(draw("path", { class: "curve", d: path, ...style }));
    }
    const cross = draw("line", { class: "cross", y1: top, y2: top + inner.height, visibility: "hidden" });
    svg.append(cross);
    if (drawn) drawn.svg.replaceWith(svg);
    else box.prepend(svg);
    drawn = { svg, cross, px, from, to, left, inner, visible, width };
  }

  /// A bound far away from the curve would flatten it.
  function near(bound, values) {
    const [low, high] = range(values, log);
    const span = Math.max(high - low, 1e-12);
    return log ? bound > 0 : bound > low - 1.5 * span && bound < high + 1.5 * span;
  }

  function point(event) {
    if (!drawn) return;
    const frame = box.getBoundingClientRect();
    const at = drawn.from + ((event.clientX - frame.left - drawn.left) / drawn.inner.width) * (drawn.to - drawn.from);
    const rows = [];
    let place = null;
    for (const s of drawn.visible) {
      const i = nearest(s.x, at);
      if (i < 0) continue;
      if (place === null || Math.abs(s.x[i] - at) < Math.abs(place - at)) place = s.x[i];
      const error = s.error && Number.isFinite(s.error[i]) ? ` ± ${shown(s.error[i], 2)}` : "";
      rows.push([s, (y.text || shown)(s.y[i]) + error]);
    }
    if (place === null) return leave();
    drawn.cross.setAttribute("x1", drawn.px(place));
    drawn.cross.setAttribute("x2", drawn.px(place));
    drawn.cross.setAttribute("visibility", "visible");
    const lines = rows.slice(0, 12).map(([s, text]) =>
      make("div", {}, make("span", { class: "key", style: `background:${s.colour}` }), series.length > 1 ? `${s.name}  ` : "", make("b", {}, text)));
    if (rows.length > 12) lines.push(make("div", { class: "soft" }, `and ${rows.length - 12} more`));
    tip.replaceChildren(make("div", { class: "soft" }, `${x.name || x.label} ${(x.text || ((v) => shown(v, 5)))(place)}`), ...lines);
    tip.hidden = false;
    const x0 = drawn.px(place);
    const beyond = x0 > drawn.width / 2;
    tip.style.left = beyond ? "" : `${x0 + 10}px`;
    tip.style.right = beyond ? `${drawn.width - x0 + 10}px` : "";
    tip.style.top = "14px";
  }

  function leave() {
    tip.hidden = true;
    if (drawn) drawn.cross.setAttribute("visibility", "hidden");
  }

  box.addEventListener("pointermove", point);
  box.addEventListener("pointerdown", point);
  box.addEventListener("pointerleave", leave);
  box.append(tip);
  new ResizeObserver(redraw).observe(box);

  const whole = make("div", {}, title ? make("h3", {}, title) : null, box);
  if (groups.length > 1) {
    // A line for curves of several colours has none.
    const grouped = (name) => new Set(series.filter((s) => s.group === name).map((s) => s.colour)).size;
    const entry = ([name, s]) => {
      const line = draw("line", { x1: 1, x2: 21, y1: 5, y2: 5, stroke: grouped(name) < 2 ? s.colour : "var(--soft)", "stroke-width": 2.5, "stroke-dasharray": s.dash || null });
      const toggle = (event) => {
        if (!hidden.delete(name)) hidden.add(name);
        event.currentTarget.setAttribute("aria-pressed", String(!hidden.has(name)));
        redraw();
      };
      return make("button", { "aria-pressed": "true", onclick: toggle, title: "show or hide" }, draw("svg", { viewBox: "0 0 22 10" }, line), name);
    };
    whole.append(make("div", { class: "legend" }, groups.map(entry)));
  }
  if (switchable) {
    const flip = (event) => {
      log = !log;
      event.currentTarget.setAttribute("aria-pressed", String(log));
      redraw();
    };
    const button = make("button", { "aria-pressed": String(log), onclick: flip }, "logarithmic");
    whole.prepend(make("div", { class: "controls", style: "float:right;margin:0" }, button));
  }
  return whole;
}

/// The index of the number nearest to `at` in a sorted list, −1 in an empty one.
function nearest(sorted, at) {
  let [low, high] = [0, sorted.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < at) low = middle + 1;
    else high = middle;
  }
  return low > 0 && Math.abs(sorted[low - 1] - at) < Math.abs(sorted[low] - at) ? low - 1 : low;
}

/// A table that scrolls within itself; cells are text or elements.
function table(head, rows) {
  const isText = (at) => rows.some((row) => row[at] instanceof Element && row[at].className === "text");
  const cell = (inner) => (inner instanceof Element && inner.tagName === "TD" ? inner : make("td", {}, inner));
  const heads = head.map((inner, at) => make("th", isText(at) ? { class: "text" } : {}, inner));
  const body = rows.map((row) => make("tr", {}, row.map(cell)));
  return make("div", { class: "scroll" }, make("table", {}, make("thead", {}, make("tr", {}, heads)), make("tbody", {}, body)));
}

/// Lines of a text with what became of them: `[" ", text]`, `["-", text]`, `["+", text]`, `null` for what is left out.
function difference(lines) {
  const one = (line) => {
    if (line === null) return make("span", { class: "soft" }, "⋯");
    const kind = { "-": "less", "+": "more" }[line[0]];
    return make("span", kind ? { class: kind } : {}, `${line[0]} ${line[1]}`);
  };
  return make("pre", {}, make("div", {}, lines.map(one)));
}

/// What a page holds, by name.
const data = JSON.parse(document.getElementById("data").textContent);
