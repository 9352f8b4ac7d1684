"use strict";
// The page about one run.

{
  const { head, optimizations, end } = data;
  const main = document.querySelector("main");
  const section = (title, ...children) => main.append(make("section", {}, make("h2", {}, title), children));
  const fact = (value, name, kind) => make("div", {}, make("b", kind ? { class: kind } : {}, value), make("span", {}, name));
  const several = optimizations.length > 1;
  const nameOf = (o, at) => (several ? `${o.of}, ${at + 1}${["st", "nd", "rd"][at] || "th"} optimisation` : o.of);
  const value = (pair) => (pair ? shown(number(pair[0])) + (number(pair[1]) > 0 ? ` ± ${shown(number(pair[1]), 2)}` : "") : "–");

  // ---- head ----
  {
    const facts = [fact(head.ended, "the run", head.isGood ? "good" : "bad"), fact(count(head.steps), "steps"), fact(seconds(number(head.seconds)), "time")];
    optimizations.forEach((o, at) => {
      const first = numbers(o.loss).find(Number.isFinite);
      facts.push(fact(`${shown(first ?? NaN)} → ${value(o.after)}`, `loss ${nameOf(o, at)}`));
    });
    const peak = Math.max(0, ...optimizations.flatMap((o) => numbers(o.bytes)));
    if (peak) facts.push(fact(bytes(peak), "memory at most"));
    if (head.samples) facts.push(fact(shown(head.samples, 3), "samples"));
    main.append(make("h1", {}, data.title), make("div", { class: "soft path" }, head.folder), make("section", {}, make("div", { class: "facts", style: "margin:0" }, facts)));
  }

  // ---- images, and how they came about ----
  optimizations.forEach((o, at) => {
    const views = (o.views || []).filter((view) => view.start || view.end);
    if (!views.length) return;
    const place = make("div", {});
    const choose = (view) => place.replaceChildren(pictures(o, view));
    const names = views.map((view, k) => (views.filter((v) => v.name === view.name).length > 1 ? `${k + 1}: ${view.name}` : view.name));
    const choice = make("select", { "aria-label": "image", onchange: (event) => choose(views[event.target.selectedIndex]) }, names.map((name) => make("option", {}, name)));
    section(`Images: ${nameOf(o, at)}`,
      views.length > 1 ? make("div", { class: "controls" }, make("label", {}, "image", choice)) : make("p", { class: "soft small" }, make("code", {}, names[0])), place);
    choose(views[0]);
  });

  function pictures(o, view) {
    const exposure = new Exposure();
    const whole = make("div", {}, make("div", { class: "controls" }, exposure.control));
    const kinds = [["start", view.start], ["end", view.end], ["target", view.target && { image: view.target }]].filter(([, picture]) => picture);
    const caption = { start: () => `start, step ${view.start.step}`, end: () => `end, after ${view.end.step} steps`, target: () => "target" };
    const images = Promise.all(kinds.map(([, picture]) => decoded(picture.image)));
    images.then((list) => {
      const by = Object.fromEntries(kinds.map(([kind], k) => [kind, list[k]]));
      const figure = (kind) => {
        const canvas = make("canvas", { class: "picture", role: "img", "aria-label": kind });
        exposure.show(() => paint(canvas, by[kind], exposure.stops));
        return make("figure", {}, canvas, make("figcaption", {}, make("b", {}, caption[kind]())));
      };
      const figures = kinds.map(([kind]) => figure(kind));
      const against = by.target ? "target" : "start";
      for (const from of ["start", "end"]) {
        if (!by[from] || !by[against] || from === against) continue;
        const found = subtracted(by[from], by[against]);
        const canvas = make("canvas", { class: "picture difference", role: "img", "aria-label": `${from} minus ${against}` });
        const scale = make("div", { class: "scale" });
        exposure.show(() => {
          paintDifference(canvas, found, exposure.stops);
          const most = shown(found.scale / 2 ** exposure.stops, 2);
          const colours = DIVERGING.map((c) => `rgb(${c})`).join(",");
          scale.replaceChildren(`−${most}`, make("i", { style: `background:linear-gradient(90deg,${colours})` }), `+${most}`);
        });
        figures.push(make("figure", {}, canvas, scale, make("figcaption", {}, make("b", {}, `${from} − ${against}`), ", mean of the channels")));
      }
      whole.append(make("div", { class: "pictures" }, figures));
      const beside = make("div", { class: "beside", style: "margin-top:22px" });
      if (kinds.length > 1) beside.append(wipe(by, exposure));
      beside.append(animation(o, view, exposure));
      whole.append(beside);
    });
    return whole;
  }

  /// Two images in one place, with a bar between them that is dragged.
  function wipe(by, exposure) {
    const kinds = Object.keys(by);
    const chosen = { left: by.end ? "end" : kinds[0], right: by.target ? "target" : kinds.find((kind) => kind !== "end") };
    const canvas = make("canvas", { class: "picture", role: "img", "aria-label": "two images in one place" });
    const bar = make("div", { class: "bar" });
    const names = { left: make("div", { class: "name", style: "left:6px" }), right: make("div", { class: "name", style: "right:6px" }) };
    const box = make("div", { class: "wipe", role: "slider", tabindex: 0, "aria-label": "wipe", "aria-valuemin": 0, "aria-valuemax": 100 }, canvas, bar, names.left, names.right);
    const layers = { left: make("canvas"), right: make("canvas") };
    let share = 0.5;
    function put() {
      const [left, right] = [layers.left, layers.right];
      const [width, height] = [Math.max(left.width, right.width), Math.max(left.height, right.height)];
      if (canvas.width !== width || canvas.height !== height) (canvas.width = width), (canvas.height = height);
      const context = canvas.getContext("2d");
      context.imageSmoothingEnabled = false;
      context.drawImage(right, 0, 0, width, height);
      const edge = Math.round(share * width);
      if (edge > 0) context.drawImage(left, 0, 0, share * left.width, left.height, 0, 0, edge, height);
      bar.style.left = `${100 * share}%`;
      box.setAttribute("aria-valuenow", String(Math.round(100 * share)));
      names.left.style.opacity = share > 0.15 ? 1 : 0;
      names.right.style.opacity = share < 0.85 ? 1 : 0;
    }
    const repaint = () => {
      for (const side of ["left", "right"]) {
        paint(layers[side], by[chosen[side]], exposure.stops);
        names[side].textContent = chosen[side];
      }
      put();
    };
    const move = (event) => {
      const frame = box.getBoundingClientRect();
      share = Math.max(0, Math.min(1, (event.clientX - frame.left) / frame.width));
      put();
    };
    box.addEventListener("pointerdown", (event) => {
      box.setPointerCapture(event.pointerId);
      move(event);
    });
    box.addEventListener("pointermove", (event) => event.buttons && move(event));
    box.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
      if (!by) return;
      event.preventDefault();
      share = Math.max(0, Math.min(1, share + by));
      put();
    });
    exposure.show(repaint);
    const select = (side) => make("select", { "aria-label": side, onchange: (event) => {
      chosen[side] = event.target.value;
      repaint();
    } }, kinds.map((kind) => make("option", kind === chosen[side] ? { selected: "" } : {}, kind)));
    return make("div", {}, make("h3", {}, "Wipe"), make("div", { class: "controls" }, select("left"), "against", select("right")), box);
  }

  /// The images of a few steps, one after the other.
  function animation(o, view, exposure) {
    const kept = [view.start, ...(view.frames || []), view.end].filter(Boolean);
    if (kept.length < 3) return "";
    const canvas = make("canvas", { class: "picture", role: "img", "aria-label": "convergence" });
    const told = make("output", {});
    const input = make("input", { type: "range", min: 0, max: kept.length - 1, step: 1, value: kept.length - 1, "aria-label": "frame" });
    const losses = new Map(o.step.map((step, k) => [step, number(o.loss[k])]));
    let images = [];
    let timer = null;
    const show = () => {
      const at = Number(input.value);
      if (images[at]) paint(canvas, images[at], exposure.stops);
      const { step } = kept[at];
      const loss = kept[at] === view.end && o.after ? number(o.after[0]) : losses.get(step);
      told.textContent = `step ${step}` + (loss === undefined ? "" : `, loss ${shown(loss, 3)}`);
    };
    Promise.all(kept.map((picture) => decoded(picture.image))).then((list) => {
      images = list;
      exposure.show(show);
    });
    const stop = () => {
      clearInterval(timer);
      timer = null;
      button.textContent = "play";
    };
    const button = make("button", { onclick: () => {
      if (timer) return stop();
      if (Number(input.value) === kept.length - 1) input.value = 0;
      show();
      button.textContent = "pause";
      timer = setInterval(() => {
        if (!canvas.isConnected || Number(input.value) >= kept.length - 1) return stop();
        input.value = Number(input.value) + 1;
        show();
      }, 120);
    } }, "play");
    input.addEventListener("input", () => (stop(), show()));
    return make("div", { class: "animation" }, make("h3", {}, "Convergence"),
      make("div", { class: "controls" }, button, input, told), make("div", { style: "max-width:512px" }, canvas));
  }

  // ---- curves ----
  const marksOf = (o) => {
    const first = o.stages[0];
    const begin = (k) => (k === 0 ? 0 : o.stages[k - 1][1]);
    return first && (o.stages.length > 1 || first[0]) ? o.stages.map(([name], k) => ({ x: begin(k), text: name || "" })) : [];
  };
  const steps = { label: "step", whole: true };

  optimizations.forEach((o, at) => {
    const loss = numbers(o.loss);
    const noise = numbers(o.noise);
    const x = o.step;
    const main = { name: "loss", x, y: loss, error: noise, colour: "var(--c0)", low: loss.map((v, i) => v - noise[i]), high: loss.map((v, i) => v + noise[i]) };
    const twice = "as its two measurements differ, averaged over neighbouring steps";
    const known = !o.measured ? "as neighbouring steps differ" : o.measured === o.count ? twice : `as neighbouring steps differ or, where a solver measures twice, ${twice}`;
    const noted = `The band is the standard error of a step's loss, ${known}.${o.every > 1 ? ` Every ${o.every}th step is shown.` : ""}`;
    section(`Loss: ${nameOf(o, at)}`,
      chart({ series: [main], x: steps, y: { label: "loss", log: loss.every((v) => !(v <= 0)) }, marks: marksOf(o), height: 300, switchable: true }),
      make("p", { class: "soft small", style: "margin:8px 0 0" }, noted));

    if (o.params.length || o.unlogged.length) {
      const one = (param) => {
        const range = (entry) => (entry.least ? { low: numbers(entry.least), high: numbers(entry.most) } : {});
        const series = param.entries.map((entry, k) => ({ name: param.name + entry.index, x, y: numbers(entry.values), colour: colour(k), dash: dash(k), width: param.entries.length > 16 ? 1 : null, ...range(entry) }));
        const bounds = param.entries.flatMap((entry, k) => [entry.lower, entry.upper].filter((b) => b !== null).map((b) => ({ y: number(b), colour: param.entries.length > 1 ? colour(k) : null })));
        const title = param.space ? `${param.name} (${param.space})` : param.name;
        const drawn = chart({ title, series, x: steps, y: { label: param.name }, marks: marksOf(o).map(({ x }) => ({ x })), bounds, height: 240 });
        const told = [param.doc, param.count ? `The mean of its ${count(param.count)} numbers; the band is from the least to the largest.` : null].filter(Boolean);
        return told.length ? make("figure", {}, drawn, told.map((text) => make("figcaption", {}, text))) : drawn;
      };
      const left = o.unlogged.length ? make("p", { class: "soft small", style: "margin:10px 0 0" }, `Not in the log, for they have many numbers: ${o.unlogged.join(", ")}.`) : null;
      section(`Params: ${nameOf(o, at)}`, make("div", { class: "tiles" }, o.params.map(one)), left);
    }

    {
      const norm = (g, k) => ({ name: g.name, x, y: numbers(g.norm), error: numbers(g.error), colour: colour(k) });
      const error = (g, k) => ({ name: `error of ${g.name}`, group: "standard errors", x, y: numbers(g.error).map((e) => (e > 0 ? e : NaN)), colour: colour(k), dash: "2 3", width: 1.2 });
      section(`Gradients: ${nameOf(o, at)}`, make("div", { class: "tiles wide" },
        chart({ title: "norm by param, and its standard error", series: [...o.gradients.map(norm), ...o.gradients.map(error)], x: steps, y: { label: "norm", log: true }, marks: marksOf(o).map(({ x }) => ({ x })) }),
        chart({ title: "learning rate", series: [{ name: "rate", x, y: numbers(o.lr), colour: "var(--c0)" }], x: steps, y: { label: "rate" }, marks: marksOf(o).map(({ x }) => ({ x })) })));
    }
  });

  // ---- time and memory ----
  if (optimizations.length) {
    const names = { render: "values: renderings and the loss", gradient: "derivatives", solver: "solver", files: "files", actions: "between steps (`every` blocks)", rest: "after the last step" };
    const sum = (list) => numbers(list).filter(Number.isFinite).reduce((a, b) => a + b, 0);
    const totals = { render: 0, gradient: 0, solver: 0, files: 0, actions: 0, rest: 0 };
    for (const o of optimizations) for (const name of Object.keys(o.phases)) totals[name] += sum(o.phases[name]) * (o.count / Math.max(o.step.length, 1));
    if (end) {
      totals.files += number(end.files);
      totals.rest = Math.max(0, number(end.seconds) - number(end.files));
    }
    const all = Object.values(totals).reduce((a, b) => a + b, 0) || 1;
    const entries = Object.entries(totals).map(([name, s], k) => [name, s, colour(k)]);
    const bar = make("div", { class: "shares" }, entries.map(([name, s, c]) => make("i", { style: `flex:${s / all};background:${c}`, title: `${names[name]}: ${seconds(s)}` })));
    const rows = entries.map(([name, s, c]) => [make("span", {}, make("span", { class: "key", style: `background:${c}` }), names[name]), seconds(s), `${shown((100 * s) / all, 2)} %`]);
    const perStep = optimizations.map((o, at) => ({ name: nameOf(o, at), x: o.step, y: numbers(o.seconds), colour: colour(at) }));
    const memory = optimizations.map((o, at) => ({ name: nameOf(o, at), x: o.step, y: numbers(o.bytes), colour: colour(at) }));
    section("Time and memory", make("div", { class: "tiles" },
      make("div", {}, bar, table(["phase", "time", "share"], rows)),
      chart({ title: "time of a step", series: perStep, x: steps, y: { label: "time", text: seconds, zero: true } }),
      chart({ title: "memory", series: memory, x: steps, y: { label: "memory", text: bytes, zero: true } })));
  }

  // ---- words ----
  if (data.told.length) {
    const one = (told) => make("div", { class: told.kind === "note" ? "told note" : "told" },
      make("div", {}, told.kind === "note" ? null : make("b", { class: "bad" }, `${told.kind}: `), told.message),
      (told.labels || []).map((text) => make("div", { class: "small" }, text)),
      told.place ? make("div", { class: "soft small" }, `${told.place}  ${told.code}`) : null,
      (told.help || []).map((text) => make("div", { class: "small" }, `help: ${text}`)));
    section("Warnings and notes", data.told.map(one));
  } else {
    section("Warnings and notes", make("p", { class: "soft" }, "None."));
  }

  if (data.script?.text) {
    const whole = make("pre", {}, data.script.text);
    const lines = difference(data.script.lines);
    const place = make("div", {}, data.script.lines.length ? lines : whole);
    const flip = (event) => {
      const isWhole = place.firstChild === whole;
      place.replaceChildren(isWhole ? lines : whole);
      event.target.textContent = isWhole ? "whole script" : "what has changed";
    };
    const copy = async (event) => {
      await navigator.clipboard.writeText(data.script.text);
      event.target.textContent = "copied";
    };
    section("The script with the found values", make("div", { class: "controls" },
      data.script.lines.length ? make("button", { onclick: flip }, "whole script") : null, make("button", { onclick: copy }, "copy")), place);
  } else {
    const why = data.script?.bytes ? `It has ${bytes(data.script.bytes)}; ` : "";
    section("The script with the found values", make("p", {}, `${why}dsl export ${head.folder} --script prints it.`));
  }
  if (data.found.length) {
    const one = ([name, x]) => make("div", {}, make("span", { class: "soft" }, name), shown(number(x), 7));
    section("Found values", make("div", { class: "columns" }, data.found.map(one)));
  }

  {
    const text = (value) => make("td", { class: "text" }, value);
    const rows = [["script", head.file], ["command", head.command], ["seed", String(head.seed)], ["threads", String(head.threads)], ["dscene", head.version], ["started", head.started]];
    for (const [name, value] of head.overrides) rows.push([`--set ${name}`, value]);
    if (data.saved.length) rows.push(["saved", data.saved.join(", ")]);
    section("Settings", table(["", ""], rows.map(([name, value]) => [name, text(value)])));
  }
}
