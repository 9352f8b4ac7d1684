"use strict";
// The page that compares runs.

{
  const { runs } = data;
  const main = document.querySelector("main");
  const section = (title, ...children) => main.append(make("section", {}, make("h2", {}, title), children));

  // Runs that differ in nothing but their seed have one colour.
  const seedless = (run) => run.kind ?? (run.label.replace(/(, )?seed = \d+/, "") || "all seeds");
  const kinds = [...new Set(runs.map(seedless))];
  const hasKinds = kinds.length > 1 && kinds.length < runs.length;
  const look = runs.map((run, at) => {
    const nth = hasKinds ? kinds.indexOf(seedless(run)) : at;
    return { colour: colour(nth), dash: dash(nth), group: hasKinds ? seedless(run) : run.label };
  });

  main.append(
    make("h1", {}, data.title),
    make("p", { class: "soft" }, `${runs.length} runs` + (runs.length ? `, dscene ${[...new Set(runs.map((run) => run.head.version))].join(", ")}` : "")),
  );

  const losses = [...new Set(runs.flatMap((run) => run.optimizations.map((o) => o.of)))];
  const last = (run, of) => run.optimizations.filter((o) => o.of === of).pop();

  // ---- a sweep's table ----
  if (data.table) {
    const { names, columns, largest, rows, left } = data.table;
    const key = (kind) => (hasKinds && kinds.includes(kind) ? make("span", { class: "key", style: `background:${colour(kinds.indexOf(kind))}` }) : null);
    const isTold = rows.some((row) => row.notes);
    const best = (at) => (largest[at] ? "the largest" : "the least");
    const body = rows.map((row) => [
      ...row.set.map((value, at) => make("td", {}, at === 0 ? key(row.kind) : null, value)),
      row.seeds, ...row.means.map(([text, isBest], at) => (isBest ? make("b", { class: "good", title: best(at) }, text) : text)),
      ...(isTold ? [make("td", { class: "text" }, row.notes)] : []),
    ]);
    const more = left ? make("p", { class: "soft small" }, `and ${count(left)} more rows, which table.csv has`) : null;
    section("Means over seeds", table([...names, "seeds", ...columns, ...(isTold ? [""] : [])], body), more);
  }

  // ---- final values ----
  {
    const reported = [...new Set(runs.flatMap((run) => run.reported.map(([name]) => name)))].filter((name) => !losses.includes(name) && name !== "seconds");
    const values = [...new Set(runs.flatMap((run) => run.found.map(([name]) => name)))].slice(0, 64);
    const after = runs.map((run) => losses.map((of) => last(run, of)?.after?.map((x) => (x === null ? NaN : number(x)))));
    const best = losses.map((_, k) => Math.min(...after.map((row) => row[k]?.[0]).filter(Number.isFinite)));
    const cell = (pair, k) => {
      if (!pair) return "–";
      const text = shown(pair[0]) + (pair[1] > 0 ? ` ± ${shown(pair[1], 2)}` : "");
      return runs.length > 1 && pair[0] === best[k] ? make("b", { class: "good", title: "the least" }, text) : text;
    };
    const rows = runs.map((run, at) => {
      const found = new Map(run.found);
      const said = new Map(run.reported);
      const numberIn = (map) => (name) => (map.has(name) ? shown(number(map.get(name)), 5) : "–");
      const key = make("span", { class: "key", style: `background:${look[at].colour}` });
      const ended = make("span", { class: run.head.isGood ? "" : "bad", title: run.head.ended }, run.head.word);
      return [
        make("td", { title: run.head.folder }, key, run.label),
        ended, String(run.head.steps), seconds(number(run.head.seconds)),
        ...after[at].map(cell), ...reported.map(numberIn(said)), ...values.map(numberIn(found)),
      ];
    });
    section("Final values", table(["run", "ended", "steps", "time", ...losses, ...reported, ...values], rows));
  }

  // ---- curves ----
  for (const of of losses) {
    const curves = (x) => runs.flatMap((run, at) => {
      const own = last(run, of);
      return own ? [{ name: run.label, x: numbers(own[x]), y: numbers(own.loss), ...look[at] }] : [];
    });
    const y = { label: "loss", log: true };
    section(`Loss: ${of}`, make("div", { class: "tiles wide" },
      chart({ title: "by steps", series: curves("step"), x: { label: "step", whole: true }, y, height: 300 }),
      chart({ title: "by time", series: curves("clock"), x: { label: "seconds of steps", name: "second", from: 0 }, y, height: 300 })));
  }

  // ---- images ----
  const { ends, saved } = data.images;
  const rows = (ends.some(Boolean) ? [{ name: "what the loss saw last", pictures: ends }] : []).concat(saved);
  if (rows.length) {
    const exposure = new Exposure();
    const row = ({ name, pictures }) => {
      const figures = runs.map((run, at) => {
        if (!pictures[at]) return make("figure", {}, make("figcaption", {}, make("b", {}, run.label), " has no such image"));
        const canvas = make("canvas", { class: "picture" });
        decoded(pictures[at]).then((image) => exposure.show(() => paint(canvas, image, exposure.stops)));
        return make("figure", {}, canvas, make("figcaption", {}, make("b", {}, run.label)));
      });
      return [make("h3", {}, name), make("div", { class: "pictures", style: "margin-bottom:18px" }, figures)];
    };
    section("Images", make("div", { class: "controls" }, exposure.control), rows.map(row));
  }

  // ---- what differs ----
  if (data.settings.length) {
    const body = runs.map((run, at) => [run.label, ...data.settings.map(([, values]) => values[at] || "–")]);
    section("Settings that differ", table(["run", ...data.settings.map(([name]) => name)], body));
  }
  if (data.diffs.length) {
    const one = ({ label, file, lines }) => [make("h3", {}, `${label}: ${file}`), difference(lines)];
    section("Scripts", make("p", { class: "soft" }, `How each differs from that of ${runs[0].label}.`), data.diffs.map(one));
  } else {
    section("Scripts", make("p", {}, "All runs have the same script."));
  }
  section("Folders", table(["run", "folder", "started", "command"], runs.map((run) => [
    run.label, make("td", { class: "text" }, run.head.folder), run.head.started, make("td", { class: "text" }, make("code", {}, run.head.command)),
  ])));
}
