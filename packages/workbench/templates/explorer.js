// Tracking error of a gyro from the committed surface, its place among the parts, and a reader's own.
"use strict";

const data = JSON.parse(byId("data").textContent);
const LEVELS = [0.12, 0.15, 0.2, 0.3, 0.5, 1, 2, 5, 10, 30, 100];
const SHADES = ["#f7fbff", "#e9f2fa", "#dbe9f6", "#cde0f1", "#bdd7ec", "#abd0e6", "#94c4df", "#7db8da", "#66abd4", "#519ccc", "#3d8dc4", "#2b7bba"];
const OWN = "#b2182b", MEASURED = "#00441b", SHEET = "#222";
let own = null; // the sensor of a model.json

const tracker = () => document.querySelector("input[name=tracker]:checked").value;
// One filter was simulated for one correlation time only.
const planes = () => data.planes[tracker()];
const corrTime = () => (Object.keys(planes()).length > 1 ? data.corr_times[time.slider.value] : Number(Object.keys(planes())[0]));
const plane = () => planes()[corrTime()];

// The same interpolation as terrain.ErrorPlane: along ln N for each B, then along ln B.
const logs = { arw: data.arw.map(Math.log), sigma_b: data.sigma_b.map(Math.log) };
function interpolate(rows, n, b, of = Math.log) {
  const [x, y] = [Math.log(Math.max(n, data.arw[0])), Math.log(Math.max(b, data.sigma_b[0]))];
  return pchip(logs.sigma_b, rows.map((row) => pchip(logs.arw, row.map(of), x)), y);
}

// Error, ends of its interval (m) and share of laps lost; null beyond the computed range. A gyro
// better than the range has the error at its edge at most, as terrain.ErrorPlane has it.
function predict(n, b) {
  if (n > data.arw.at(-1) * (1 + 1e-9) || b > data.sigma_b.at(-1) * (1 + 1e-9)) return null;
  const at = plane(), [error, low, high] = [at.error, at.low, at.high].map((rows) => Math.exp(interpolate(rows, n, b)));
  return { error, low, high, lost: Math.min(Math.max(interpolate(at.lost, n, b, (x) => x), 0), 1) };
}

const better = (n, b) => n < data.arw[0] * (1 - 1e-9) || b < data.sigma_b[0] * (1 - 1e-9);

function within(range, symbol, quantity) {
  const [least, most] = [range[0], range.at(-1)];
  if (quantity.value <= most * (1 + 1e-9)) return null;
  return `outside the computed range: ${symbol} ${quantity.words(least, 3)} to ${quantity.words(most, 3)}`;
}

const inputs = byId("quantities"), changed = () => update();
const N = new Quantity(inputs, {
  id: "n", symbol: "N", name: "Angle random walk N", units: GYRO.N, value: 0.005, least: data.arw[0], most: data.arw.at(-1),
  refuse: () => within(data.arw, "N", N), changed,
});
const B = new Quantity(inputs, {
  id: "b", symbol: "B", name: "Bias B (its standard deviation σ_b, as in the terrain paper)", units: GYRO.B, value: 0.002, least: data.sigma_b[0], most: data.sigma_b.at(-1),
  refuse: () => within(data.sigma_b, "B", B), changed,
});

// The correlation time has the values that were simulated, and no other.
const time = { id: "t", slider: made("input", { type: "range", min: 0, max: data.corr_times.length - 1, step: 1, value: 2, "aria-label": "T_c, slider" }) };
time.choice = made("select", { id: "t" }, ...data.corr_times.map((t, i) => made("option", { value: i, textContent: `${t} s` })));
time.set = (i) => {
  time.slider.value = time.choice.value = i;
  time.slider.setAttribute("aria-valuetext", `${data.corr_times[i]} s`);
};
for (const input of [time.slider, time.choice]) {
  input.addEventListener("input", () => {
    time.set(input.value);
    update();
  });
}
inputs.append(made("div", { className: "quantity" }, made("label", { for: "t", textContent: "Correlation time T_c of the bias" }), time.slider, time.choice));
time.set(2);

const price = new Quantity(inputs, { id: "usd", symbol: "price", name: "Price limit", units: { USD: 1 }, value: 3000, least: 1, most: 100000, changed });
price.choice.hidden = true;
price.choice.before(made("span", { textContent: "USD" }));

takeModels(byId("own"), (model, file) => {
  const rates = model.channels.filter((c) => c.kind === "rate");
  if (!rates.length) throw new Error("it has no gyro (no channel of kind 'rate')");
  const sensors = rates.map(sensorOf).filter((s) => s.n);
  if (!sensors.length) throw new Error("its log gives no N, or no bound of B, for any gyro axis");
  byId("axis")?.parentNode.remove();
  const choice = made("select", { id: "axis" }, ...sensors.map((s, i) => made("option", { value: i, textContent: s.name })));
  const take = () => {
    own = sensors[choice.value];
    N.set(own.n);
    B.set(own.b ?? own.b_high);
    update();
  };
  choice.addEventListener("change", take);
  byId("own").append(made("p", {}, made("label", { for: "axis", textContent: "axis that measures pitch " }), choice));
  take();
  const left = rates.length - sensors.length;
  return `${file}: ${sensors.length} gyro ${sensors.length > 1 ? "axes" : "axis"}${left ? `; ${left} left out: no N, or no bound of B` : ""}.`;
});

// N and B as terrain.Sensor.from_model takes them: without a floor the upper bound of B.
function sensorOf(channel) {
  const scale = IN_BASE[channel.unit], { arw = {}, bias_instability: b = {} } = channel.parameters;
  if (!scale || !sound(arw.value) || !(sound(b.value) || sound(b.high))) return { name: channel.name };
  const found = { name: channel.name, basis: "own", corr_time: sound(channel.parameters.corr_time?.value) };
  for (const [symbol, from] of [["n", arw], ["b", b]]) {
    for (const [key, end] of [["value", ""], ["low", "_low"], ["high", "_high"]]) {
      found[symbol + end] = sound(from[key]) && scale * from[key];
    }
  }
  return found;
}

// The error of a sensor with the interval that its N and B leave; null at an end beyond the range.
function ofSensor(s) {
  const at = (n, b, end = "error") => predict(n, b)?.[end] ?? null, value = s.b ? at(s.n, s.b) : null;
  if (!s.n_low && !s.n_high) return { value, most: better(s.n, s.b) };
  return { value, low: s.b ? at(s.n_low ?? 0, s.b_low ?? 0, "low") : null, high: s.b_high && s.n_high ? at(s.n_high, s.b_high, "high") : null, most: better(s.n, s.b ?? s.b_high) };
}

const metres = (x) => `${rounded(x)} m`;
function errorWords({ value, low, high, most }) {
  if (value === null || value === undefined) return high ? `at most ${metres(high)}` : "beyond the computed range";
  if (most) return `at most ${metres(value)}`;
  if (low) return `${rounded(value)} (${high ? `${rounded(low)} to ${rounded(high)}` : `at least ${rounded(low)}`}) m`;
  return metres(value);
}

// Every part once, measured ones first: by its worst axis, as on a report, with the sheet under it.
function listed() {
  const found = new Map();
  for (const one of data.parts) {
    const e = ofSensor(one), entry = { ...one, e, size: e.value ?? e.high ?? Infinity }, { measured, sheet } = found.get(one.part) ?? {};
    if (one.basis === "datasheet") found.set(one.part, { measured, sheet: entry });
    else found.set(one.part, { measured: measured && measured.size >= entry.size ? measured : entry, sheet });
  }
  const parts = [...found.values()].map(({ measured, sheet }) => (measured ? { ...measured, name: sheet?.name ?? measured.name, sheet } : sheet));
  const order = (part) => (part.basis === "measured" ? 0 : 1);
  return parts.sort((a, b) => order(a) - order(b) || a.size - b.size);
}

// N of all axes of a part over that of its data sheet.
function overSheet(part) {
  const over = data.parts.filter((p) => p.part === part && p.over_sheet).map((p) => p.over_sheet);
  const ends = [Math.min(...over), Math.max(...over)].map((x) => rounded(x));
  return over.length ? `N of its ${over.length} axes: ${ends.join(" to ")} times that of the data sheet` : "";
}

function priceWords(part) {
  return part.low_usd === null ? "not traced" : `${part.low_usd.toLocaleString("en")} to ${part.high_usd.toLocaleString("en")} USD`;
}

const plot = new Plot(byId("plane"), {
  title: "Tracking error over N and B", height: 430, log: "xy", left: 50, series: [],
  x: "N", y: "B", drag: (n, b) => {
    N.set(clamp(n / N.units[N.unit], data.arw));
    B.set(clamp(b / B.units[B.unit], data.sigma_b), true);
  },
  tip: (i) => plot.points.words[i],
});
const clamp = (x, range) => Number(Math.min(Math.max(x, range[0]), range.at(-1)).toPrecision(4));

const fields = new Map();
function field() {
  const key = tracker() + corrTime();
  if (!fields.has(key)) {
    const spread = (range, count) => Array.from({ length: count }, (_, i) => range[0] * (range.at(-1) / range[0]) ** (i / (count - 1)));
    const [xs, ys] = [spread(data.arw, 61), spread(data.sigma_b, 65)], table = plane().error.map((row) => row.map(Math.log));
    const columns = xs.map((n) => {
      const along = table.map((row) => pchip(logs.arw, row, Math.log(n)));
      return ys.map((b) => pchip(logs.sigma_b, along, Math.log(b)));
    });
    fields.set(key, { xs, ys, z: ys.map((_, j) => xs.map((_, i) => columns[i][j])) });
  }
  return fields.get(key);
}

function draw(listed) {
  const parts = listed.flatMap((p) => (p.sheet ? [p, p.sheet] : [p]));
  const [fx, fy] = [N.units[N.unit], B.units[B.unit]], { xs, ys, z } = field();
  const scaled = (list, name, factor) => list.map((s) => (s[name] ? s[name] * factor : null));
  const marks = (list, more) => ({
    kind: "marks", ...more, x: scaled(list, "n", fx), y: list.map((s) => (s.b ?? s.b_high) * fy),
    x_low: scaled(list, "n_low", fx), x_high: scaled(list, "n_high", fx), y_low: scaled(list, "b_low", fy), y_high: scaled(list, "b_high", fy),
  });
  const series = [
    { kind: "field", xs: xs.map((x) => x * fx), ys: ys.map((y) => y * fy), z, levels: LEVELS.map(Math.log), colours: SHADES, names: LEVELS.map((l) => `${l} m`), x: [xs[0] * fx, xs.at(-1) * fx], y: [ys[0] * fy, ys.at(-1) * fy] },
    marks(parts.filter((p) => p.basis === "datasheet"), { colour: SHEET, shape: "ring", size: 4 }),
    marks(parts.filter((p) => p.basis === "measured"), { colour: MEASURED, shape: "disc", size: 5 }),
  ];
  if (own) series.push(marks([own], { colour: OWN, shape: "square", size: 5 }));
  series.push({ kind: "marks", x: [Math.max(N.value, xs[0]) * fx], y: [Math.max(B.value, ys[0]) * fy], colour: OWN, shape: "target", size: 6 });
  const shown = own ? [...parts, { ...own, e: ofSensor(own), name: `your ${own.name}` }] : parts;
  plot.points = {
    x: scaled(shown, "n", fx), y: shown.map((s) => (s.b ?? s.b_high) * fy),
    words: shown.map((s) => `${s.name}${s.basis === "measured" ? `, ${s.axis}, measured` : s.basis === "datasheet" ? ", data sheet" : ""}: N ${N.words(s.n, 3)}, B ${s.b ? "" : "at most "}${B.words(s.b ?? s.b_high, 3)}; ${errorWords(s.e)}`),
  };
  [plot.x, plot.y, plot.place] = [`angle random walk N (${N.unit})`, `standard deviation of the bias, B = σ_b (${B.unit})`, [N.value * fx, B.value * fy]];
  plot.series = series;
  plot.reset();
  plot.view = { x0: Math.log10(xs[0] * fx), x1: Math.log10(xs.at(-1) * fx), y0: Math.log10(ys[0] * fy), y1: Math.log10(ys.at(-1) * fy) };
  plot.draw();
}

function tell(id, parts, last, say) {
  const details = (of, more) => {
    const source = [of.source, more, of.price_source && `Price (${of.price_year}): ${of.price_source}`].filter(Boolean).join(". ");
    const words = of.basis === "measured" ? `measured in this compendium, worst axis: ${of.axis}` : "data sheet";
    return made("details", {}, made("summary", { textContent: words }), made("small", { textContent: source }));
  };
  // The sheet's number stands under the measured one.
  const both = (part, words) => (part.sheet ? made("div", {}, words(part), made("div", { className: "sheet", textContent: `data sheet: ${words(part.sheet)}` })) : words(part));
  const rows = parts.map((part) => {
    const name = made("div", {}, made("b", { textContent: part.name }), details(part, part.sheet && overSheet(part.part)), ...(part.sheet ? [details(part.sheet)] : []));
    const bias = (p) => `${p.b ? "" : "at most "}${B.words(p.b ?? p.b_high, 3)}`;
    return [name, both(part, (p) => errorWords(p.e)), both(part, (p) => N.words(p.n, 3)), both(part, bias), priceWords(part), say(part)];
  });
  table(id, ["part", "error along the road", "N", "B taken as σ_b", "price", last], rows);
}

function update() {
  const wrong = [N, B, price].map((q) => q.wrong).filter(Boolean), answer = byId("answer"), found = wrong.length ? null : predict(N.value, B.value);
  const parts = listed();
  time.slider.disabled = time.choice.disabled = Object.keys(planes()).length === 1;
  draw(parts);
  answer.className = found ? "verdict" : "verdict no";
  for (const key of Object.keys(answer.dataset)) delete answer.dataset[key];
  const said = made("p", { id: "error", textContent: `No prediction: ${wrong.join("; ")}.` }), rest = [];
  if (found) {
    Object.assign(answer.dataset, found);
    const lost = found.lost < 0.0005 ? "no lap is lost" : `${digits(100 * found.lost, 2)} % of the laps are lost`;
    said.textContent = errorWords({ ...found, value: found.error, most: better(N.value, B.value) });
    const at = [`N ${N.words()},`, `B ${B.words()},`, `T_c ${corrTime()} s.`].flatMap((words) => [" ", made("span", { className: "unit", textContent: words })]);
    rest.push(`In 95 % of all moments the error along the road is below this; ${lost}.`, ...at);
    if (better(N.value, B.value)) rest.push(" The gyro is better than what was computed: this is the error at the edge.");
  }
  if (own) {
    const e = ofSensor(own);
    rest.push(made("span", { id: "own-error", textContent: ` Your ${own.name}, with the intervals of its N and B: ${errorWords(e)}.${own.corr_time ? ` Its log gives T_c = ${digits(own.corr_time)} s.` : ""}` }));
    Object.assign(answer.dataset, { ownLow: e.low, ownValue: e.value, ownHigh: e.high });
    if (better(own.n, own.b ?? own.b_high)) rest.push(" It is better than what was computed: this is the error at the edge.");
  }
  answer.replaceChildren(said, ...rest);
  if (!found) {
    byId("rule").textContent = byId("rest-said").textContent = "";
    for (const id of ["parts", "rest"]) byId(id).replaceChildren();
    plot.say("Tracking error over N and B: no prediction at the point");
    return;
  }
  plot.say(`Tracking error over N and B: ${said.textContent} at N ${N.words()}, B ${B.words()}`);
  const limit = Number(found.error.toPrecision(2)), as = (part) => Number((part.e.value ?? part.e.high ?? Infinity).toPrecision(2)) <= limit;
  const fits = (part) => as(part) && (part.low_usd === null || part.low_usd <= price.value);
  const good = parts.filter(fits), others = parts.filter((part) => !fits(part));
  const measured = parts.filter((part) => part.basis === "measured").length;
  byId("rule").textContent = `${good.length} of ${parts.length} parts: error at most ${metres(limit)}, price not above ${price.words()}. ${parts.length - measured} are judged by their data sheets; ${measured}, which come first, by what was measured here, with the data sheet under it.`;
  tell("parts", good, "within the price", (p) => (p.low_usd === null ? "not known" : p.high_usd <= price.value ? "yes" : "at the lower end of its range"));
  byId("rest-said").textContent = `The other ${others.length} parts: above that error or price, or their log leaves it open`;
  tell("rest", others, "why not", (p) => [as(p) ? "" : "error", p.low_usd !== null && p.low_usd > price.value ? "price" : ""].filter(Boolean).join(", "));
  const t = corrTime();
  keepInAddress([N, B, price], { t, tracker: tracker() }, { n: N.value, s: B.value, t });
}

byId("key").append(
  ...[["your point", OWN], ["your log", OWN], ["measured", MEASURED], ["data sheet", SHEET]].map(([name, colour], i) =>
    made("span", {}, made("i", { className: ["target", "square", "disc", "ring"][i], style: `color:${colour}` }), name)),
);
byId("inputs").addEventListener("submit", (event) => event.preventDefault());
for (const radio of document.querySelectorAll("input[name=tracker]")) radio.addEventListener("change", update);
function restore() {
  const given = fromAddress([N, B, price]), at = data.corr_times.indexOf(Number(given.get("t")));
  if (at >= 0) time.set(at);
  const radio = [...document.querySelectorAll("input[name=tracker]")].find((r) => r.value === given.get("tracker"));
  if (radio) radio.checked = true;
  update();
}
addEventListener("hashchange", restore);
restore();
