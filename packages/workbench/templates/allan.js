// Allan deviation of a sum of noise terms, its band for a log of some length, and what such a log tells.
"use strict";

const data = JSON.parse(byId("data").textContent);
const FLICKER = Math.sqrt((2 * Math.log(2)) / Math.PI), POINTS = 70, ENOUGH = 0.2;
const BLUE = "#0b559f", OWN = "#b2182b", GREY = "#666";
const RANGES = {
  rate: { units: GYRO, N: [0.004, 1e-5, 1], B: [0, 1e-6, 1], S: [0.002, 1e-6, 1], K: [0, 1e-8, 1e-2], D: [0, 1e-9, 1e-3] },
  accel: { units: ACCEL, N: [1e-4, 1e-6, 1e-2], B: [0, 1e-7, 1e-2], S: [2e-5, 1e-7, 1e-2], K: [0, 1e-9, 1e-4], D: [0, 1e-12, 1e-6] },
};
let own = null; // a channel of a model.json, in base units

// The curve: noise.adev_model ------------------------------------------------------------------

function gaussMarkov(tau, sigma, corr, dt) {
  const x = tau / corr;
  if (x < 1e-3) return sigma ** 2 * ((2 * x) / 3 - x ** 2 / 2 + (7 * x ** 3) / 30) * (1 + (dt / tau) ** 2 / 2);
  const m = tau / dt, step = -Math.expm1(-dt / corr);
  const sum = (k) => k + (2 * (1 - step) * (k * step + Math.expm1((-k * dt) / corr))) / step ** 2;
  return (sigma ** 2 * (4 * sum(m) - sum(2 * m))) / (2 * m ** 2);
}

function variances(t, tau) {
  return {
    N: t.N ** 2 / tau, B: (FLICKER * t.B) ** 2, S: t.S ? gaussMarkov(tau, t.S, t.T, t.dt) : 0,
    K: (t.K ** 2 * tau) / 3, D: (t.D * tau) ** 2 / 2,
  };
}

function deviation(t, tau) {
  return Math.sqrt(Object.values(variances(t, tau)).reduce((a, b) => a + b));
}

// The band: degrees of freedom of the mixture, as noise.allan.degrees_of_freedom -----------------

function remainder(x) {
  if (x < 0.05) return (-(x ** 3) / 6) * (1 - (x / 4) * (1 - (x / 5) * (1 - x / 6)));
  return Math.exp(-x) - 1 + x - x ** 2 / 2;
}

// Generalised covariance of the running sum at a lag of k samples.
function covariance(t, k) {
  const c = t.T / t.dt, a = Math.abs(k);
  let g = ((-(t.N ** 2) / t.dt) * a) / 2 + (t.K ** 2 * t.dt * a ** 3) / 12;
  if (t.B && a) g += (t.B ** 2 / (2 * Math.PI)) * a ** 2 * Math.log(a);
  if (t.S) g -= (t.S * c) ** 2 * remainder(a / c);
  return g;
}

// Mean and 95 % ends of the overlapped Allan variance of n samples, averaged over m.
function spread(t, m, n) {
  const terms = n - 2 * m + 1, stride = Math.max(1, Math.floor(m / 16)), reach = Math.min(8 * m + 1, terms);
  const at = (lag) => [1, -4, 6, -4, 1].reduce((sum, c, j) => sum + c * covariance(t, lag + (j - 2) * m), 0);
  const zero = at(0), drift = t.D * m * t.dt, noise = deviation({ ...t, D: 0 }, m * t.dt) ** 2;
  let [squares, along] = [0, 0];
  for (let lag = 0; lag < reach; lag += stride) {
    const share = 1 - lag / terms, c = at(lag);
    squares += (c / zero) ** 2 * share * (lag ? 2 : 1);
    along += (c / m ** 2) * share * (lag ? 2 : 1);
  }
  const mean = noise + drift ** 2 / 2, scatter = 2 * noise ** 2 * Math.min((stride * squares) / terms, 1);
  // A line adds its own square, and its product with the mean difference.
  const edf = (2 * mean ** 2) / (scatter + drift ** 2 * Math.max((stride * along) / terms, 0));
  return { mean, edf, low: mean * chiSquare(0, edf), high: mean * chiSquare(1, edf) };
}

// Ends of chi-square over its degrees of freedom: from the table, beyond it by Wilson and Hilferty.
function chiSquare(end, edf) {
  if (edf >= data.freedom.at(-1)) return (1 - 2 / (9 * edf) + (end ? 1.959964 : -1.959964) * Math.sqrt(2 / (9 * edf))) ** 3;
  return Math.exp(pchip(data.freedom.map(Math.log), data.ends[end].map(Math.log), Math.log(Math.max(edf, 1))));
}

// What a log tells: noise.planner, on noise.spectrum.outline and noise.likelihood.bin_variance ----

function outline(n) {
  const bins = [];
  for (const parity of [0, 1]) {
    const size = Math.floor((n + 1 - parity) / 2), edge = Array.from({ length: Math.min(size, 40) }, (_, i) => i);
    if (size <= 40) edge.push(size);
    else {
      const steps = Math.ceil(14 * Math.log(size / 40));
      for (let i = 0; i <= steps; i++) edge.push(Math.round(40 * (size / 40) ** (i / steps)));
    }
    const unique = [...new Set(edge)];
    for (let i = 0; i + 1 < unique.length; i++) {
      if (parity === 0 && i === 0) continue; // the mean
      const k = parity + unique[i] + unique[i + 1] - 1;
      bins.push({ parity, count: unique[i + 1] - unique[i], lam: 4 * Math.sin((Math.PI * k) / (2 * n)) ** 2 });
    }
  }
  return bins;
}

function ofBias(bin, n, dt, corr) {
  const x = dt / corr, less = -Math.expm1(-x), phi = 1 - less, scale = 1 / (phi * bin.lam + less ** 2);
  const reach = bin.parity ? 1 + Math.exp(-n * x) : -Math.expm1(-n * x);
  const edge = scale ** 2 * less ** 2 * 2 * phi * reach * (2 / n) * (1 - bin.lam / 4);
  return 1 + phi * (2 * less - bin.lam) * scale - edge;
}

const ladder = { n: 0, dt: 0, of: [] }; // flicker noise of B = 1 in each bin
function flicker(bins, n, dt) {
  if (ladder.n !== n || ladder.dt !== dt) {
    const rungs = Math.ceil(Math.log((100 / 0.55) * n) / Math.log(3));
    const of = bins.map((bin) => {
      let sum = 0;
      for (let i = 0; i < rungs; i++) sum += ofBias(bin, n, dt, 0.55 * dt * 3 ** i);
      return (sum * Math.log(3)) / Math.PI;
    });
    Object.assign(ladder, { n, dt, of });
  }
  return ladder.of;
}

// 95 % half width of the logarithm of each term that is there, after so many hours.
function relativeError(t, hours) {
  const n = Math.round((3600 * hours) / t.dt), bins = outline(n), names = ["N", "S", "T", "B", "K"].filter((k) => (k === "T" ? t.S : t[k]));
  const rung = t.B ? flicker(bins, n, t.dt) : null;
  const logVariance = (s) => bins.map((bin, i) => {
    let v = s.N ** 2 / t.dt;
    if (s.S) v += s.S ** 2 * ofBias(bin, n, t.dt, s.T);
    if (s.B) v += s.B ** 2 * rung[i];
    if (s.K) v += (s.K ** 2 * t.dt) / bin.lam;
    return Math.log(v);
  });
  const step = 1e-4;
  const slopes = names.map((name) => {
    const [up, down] = [step, -step].map((h) => logVariance({ ...t, [name]: t[name] * Math.exp(h) }));
    return up.map((v, i) => (v - down[i]) / (2 * step));
  });
  const information = slopes.map((a) => slopes.map((b) => 0.5 * bins.reduce((sum, bin, i) => sum + a[i] * b[i] * bin.count, 0)));
  const scale = information.map((row, i) => Math.sqrt(row[i])), seen = names.map((_, i) => i).filter((i) => scale[i] > 0);
  const inverse = invert(seen.map((i) => seen.map((j) => information[i][j] / scale[i] / scale[j])));
  const found = Object.fromEntries(names.map((name) => [name, Infinity]));
  seen.forEach((i, k) => (found[names[i]] = (1.96 * Math.sqrt(Math.max(inverse[k][k], 0))) / scale[i]));
  return found;
}

function invert(matrix) {
  const n = matrix.length, rows = matrix.map((row, i) => [...row, ...row.map((_, j) => (i === j ? 1 : 0))]);
  for (let i = 0; i < n; i++) {
    const best = rows.slice(i).reduce((b, row, k) => (Math.abs(row[i]) > Math.abs(rows[b][i]) ? i + k : b), i);
    [rows[i], rows[best]] = [rows[best], rows[i]];
    const pivot = rows[i][i];
    rows[i] = rows[i].map((v) => v / pivot);
    for (let k = 0; k < n; k++) if (k !== i) rows[k] = rows[k].map((v, j) => v - rows[k][i] * rows[i][j]);
  }
  return rows.map((row) => row.slice(n));
}

// Hours until a term is known to ±20 %; null where eleven years are not enough.
function hoursNeeded(t, name) {
  const wanted = Math.log1p(ENOUGH), short = (log) => Math.log(Math.min(relativeError(t, Math.exp(log))[name] / wanted, 1e6));
  const times = name === "S" || name === "T" ? 10 * t.T : 0;
  let [low, high] = [Math.log(Math.max(1000 * t.dt, times) / 3600), Math.log(1e5)];
  if (low >= high) return null;
  if (short(low) <= 0) return Math.exp(low);
  if (!(short(high) <= 0)) return null;
  while (high - low > 1e-3) {
    const middle = (low + high) / 2;
    if (short(middle) > 0) low = middle;
    else high = middle;
  }
  return Math.exp((low + high) / 2);
}

// The page ---------------------------------------------------------------------------------------

const kind = () => document.querySelector("input[name=kind]:checked").value;
const place = byId("quantities"), changed = () => update();
const quantity = (id, symbol, name, key, off) => {
  const [value, least, most] = RANGES.rate[key];
  return new Quantity(place, { id, symbol, name, units: GYRO[key === "S" ? "B" : key], value, least, most, off, changed });
};
const q = {
  N: quantity("n", "N", "White noise N", "N"),
  S: quantity("s", "σ_b", "Gauss–Markov bias σ_b", "S", true),
  T: new Quantity(place, { id: "t", symbol: "T_c", name: "Its correlation time T_c", units: TIME, value: 200, least: 1, most: 1e5, changed }),
  B: quantity("b", "B", "Flicker noise B (IEEE 952)", "B", true),
  K: quantity("k", "K", "Rate random walk K", "K", true),
  D: quantity("d", "drift", "Linear drift", "D", true),
  rate: new Quantity(place, { id: "hz", symbol: "rate", name: "Sampling rate", units: { Hz: 1 }, value: 100, least: 1, most: 2000, changed,
    refuse: (v) => (v > 1e5 ? "rate: above 100,000 Hz the page does not compute." : null) }),
  length: new Quantity(place, { id: "len", symbol: "length", name: "Length of the log", units: { h: 1 / 3600, min: 1 / 60, s: 1 }, value: 7200, least: 60, most: 1e6, changed,
    refuse: (v) => (v > 4e7 ? "length: above 11,000 hours the page does not compute." : null) }),
};
const all = Object.values(q);

function setKind() {
  const of = RANGES[kind()];
  for (const key of ["N", "S", "B", "K", "D"]) q[key].renew(of.units[key === "S" ? "B" : key], ...of[key]);
}

const plot = new Plot(byId("curve"), {
  title: "Allan deviation against averaging time", height: 400, log: "xy", left: 50, series: [], x: "averaging time τ (s)", y: "",
  tip: (i) => plot.points.words[i], fixed: true,
});

takeModels(byId("own"), (model, file) => {
  const drawn = model.channels.filter((c) => IN_BASE[c.unit] && c.allan && Array.isArray(c.allan.tau_s) && c.allan.tau_s.length);
  if (!drawn.length) throw new Error("it has no gyro or accelerometer with an Allan curve (`allan` in the channel)");
  const channels = drawn.filter((c) => sound((c.parameters.arw || c.parameters.vrw)?.value)), without = drawn.filter((c) => !channels.includes(c));
  if (!channels.length) throw new Error("its log resolves the white noise N of no channel");
  byId("axis")?.parentNode.remove();
  const choice = made("select", { id: "axis" }, ...channels.map((c, i) => made("option", { value: i, textContent: c.name })));
  const take = () => takeChannel(channels[choice.value], model.source || {});
  choice.addEventListener("change", take);
  byId("own").append(made("p", {}, made("label", { for: "axis", textContent: "channel " }), choice));
  take();
  const left = without.length ? ` Left out for want of an N: ${without.map((c) => c.name).join(", ")}.` : "";
  return `${file}: ${channels.map((c) => c.name).join(", ")}. What its log does not resolve is left out of the model.${left}`;
});

function takeChannel(channel, source) {
  const scale = IN_BASE[channel.unit], p = channel.parameters;
  const value = (key) => (p[key] && sound(p[key].value) ? scale * p[key].value : 0);
  document.querySelector(`input[name=kind][value=${channel.kind === "accel" || ["g", "mg", "m/s^2"].includes(channel.unit) ? "accel" : "rate"}]`).checked = true;
  setKind();
  own = { name: channel.name, tau: channel.allan.tau_s.map(sound) };
  for (const key of ["deviation", "low", "high"]) own[key] = own.tau.map((_, i) => (sound(channel.allan[key]?.[i]) ? scale * channel.allan[key][i] : null));
  // Flicker noise stands for a floor that neither a bias nor a walk makes.
  const bias = p.corr_time && sound(p.corr_time.value);
  q.N.set(value("arw") || value("vrw"));
  q.S.set(bias ? value("sigma_b") : 0);
  if (bias) q.T.set(p.corr_time.value);
  q.B.set(bias || value("rrw") ? 0 : value("bias_instability"));
  q.K.set(value("rrw"));
  q.D.set(p.drift && typeof p.drift.value === "number" ? Math.abs(scale * p.drift.value) : 0);
  if (sound(source.rate_hz)) q.rate.set(source.rate_hz);
  if (sound(source.duration_s)) q.length.set(source.duration_s);
  update();
}

function hoursWords(h) {
  if (h === null) return "more than eleven years";
  if (h < 1 / 60) return `${digits(3600 * h, 2)} s`;
  if (h < 1) return `${digits(60 * h, 2)} min`;
  return h < 48 ? `${digits(h, 2)} h` : `${digits(h / 24, 2)} days`;
}

// A length of the log, of the bias also in correlation times.
const lengthWords = (h, t, name) => `${hoursWords(h)}${h && (name === "S" || name === "T") ? ` (${digits((3600 * h) / t.T)} T_c)` : ""}`;

function known(e) {
  if (!(e < Math.log(100))) return "not at all";
  const up = 100 * Math.expm1(e);
  return up < 100 ? `−${digits(-100 * Math.expm1(-e), 2)} % to +${digits(up, 2)} %` : `to a factor of ${digits(Math.exp(e), 2)}`;
}

function update() {
  const wrong = all.map((one) => one.wrong).filter(Boolean), t = { dt: 1 / q.rate.value, ...Object.fromEntries(["N", "S", "T", "B", "K", "D"].map((k) => [k, q[k].value])) };
  const n = Math.round(q.length.value * q.rate.value), hours = q.length.value / 3600, answer = byId("answer");
  if (!wrong.length && n < 40) wrong.push(`a log of ${n} samples is too short; give 40 or more`);
  if (!wrong.length && t.S && t.T < t.dt) wrong.push(`T_c ${q.T.words()} is shorter than a sample, ${digits(t.dt)} s`);
  answer.className = wrong.length ? "verdict no" : "verdict";
  if (wrong.length) {
    answer.replaceChildren(made("p", { textContent: wrong.join(" ") }));
    for (const id of ["told", "study"]) byId(id).replaceChildren();
    byId("times").textContent = byId("here").textContent = "";
    plot.points = null;
    return plot.show([]);
  }
  // The curve over the whole log, its band up to a quarter of it.
  const unit = q.B.unit, factor = q.B.units[unit], most = Math.floor(n / 4);
  const sizes = [...new Set(Array.from({ length: POINTS }, (_, i) => Math.round(most ** (i / (POINTS - 1)))))];
  const band = sizes.map((m) => spread(t, m, n)), tau = sizes.map((m) => m * t.dt), adev = tau.map((s) => deviation(t, s));
  const root = (key) => band.map((b) => factor * Math.sqrt(b[key]));
  const series = [{ kind: "band", x: tau, low: root("low"), high: root("high"), colour: "#b9d4ec" }];
  for (const key of ["N", "S", "B", "K", "D"]) {
    const part = tau.map((s) => factor * Math.sqrt(variances(t, s)[key]));
    if (q[key].value && adev.some((a, i) => part[i] > 0.2 * factor * a)) series.push({ kind: "line", x: tau, y: part.map((v, i) => (v > 0.03 * factor * adev[i] ? v : null)), colour: GREY, dash: [4, 3], width: 1 });
  }
  series.push({ kind: "line", x: tau, y: adev.map((a) => factor * a), colour: BLUE, width: 2.2 });
  if (own) {
    const scaled = (key) => own[key].map((v) => (v === null ? null : v * factor));
    series.push({ kind: "band", x: own.tau, low: scaled("low"), high: scaled("high"), colour: "#b2182b33" });
    series.push({ kind: "line", x: own.tau, y: scaled("deviation"), colour: OWN, width: 1.6 });
  }
  plot.points = { x: tau, y: adev.map((a) => factor * a), words: tau.map((s, i) => `τ ${digits(s)} s: ${digits(factor * adev[i])} ${unit}; of a log ${digits(root("low")[i])} to ${digits(root("high")[i])}`) };
  plot.y = `Allan deviation (${unit})`;
  plot.series = series;
  plot.reset();
  plot.draw();
  const valley = adev.findIndex((a, i) => a < adev[i + 1]), ends = valley < 1, least = ends ? adev.length - 1 : valley;
  const floor = ends ? `The curve has no floor within a quarter of the log; it ends at τ = ${digits(tau[least])} s` : `Its floor lies at τ = ${digits(tau[least])} s`;
  const words = `${floor}, at ${digits(factor * adev[least])} ${unit} (curves of logs: ${digits(root("low")[least])} to ${digits(root("high")[least])} ${unit}).`;
  const flat = ends ? "" : ` Over 0.664 that is a bias instability (IEEE 952) of ${digits((factor * adev[least]) / FLICKER)} ${unit}${t.S ? "; σ_b is another number" : ""}.`;
  answer.replaceChildren(made("span", { textContent: words + flat }));
  plot.say(`Allan deviation of this sensor from τ ${digits(tau[0])} to ${digits(tau.at(-1))} s. ${words}`);
  // What the log tells.
  const error = relativeError(t, hours), names = { N: "N (and σ_v)", S: "σ_b", T: "T_c", B: "B", K: "K" }, few = hours * 3600 < 10 * t.T;
  const said = (name) => (few && (name === "S" || name === "T") ? `not resolved: ${digits((3600 * hours) / t.T, 2)} correlation times, below ten no number is given` : known(error[name]));
  table("told", ["term", "value", `known after ${hoursWords(hours)} (95 %)`, "length of the log for ±20 %"],
    Object.keys(error).map((name) => [names[name], q[name].words(), said(name), lengthWords(hoursNeeded(t, name), t, name)]));
  Object.assign(byId("told").dataset, { error: JSON.stringify(error) });
  answer.dataset.band = JSON.stringify(sizes.map((m, i) => [m, adev[i], band[i].edf, Math.sqrt(band[i].low), Math.sqrt(band[i].high)]));
  study(t, hours);
  keepInAddress(all, { kind: kind() }, { n: t.N, b: t.S || t.B || 1e-5, t: t.T });
  byId("other").hidden = kind() !== "rate";
}

// The simulated sensors that are most like this one, and how often their logs resolved T_c.
function study(t, hours) {
  byId("study").hidden = !t.S;
  const needed = t.S ? hoursNeeded(t, "T") : null;
  byId("here").textContent = needed ? ` With the numbers above it takes ${digits((3600 * needed) / t.T)}.` : "";
  byId("times").textContent = "";
  if (!t.S) return;
  const times = (3600 * hours) / t.T, above = Math.sqrt((2 * t.S ** 2 * t.T) / t.N ** 2);
  const far = (row) => Math.log(row.times / times) ** 2 + 0.25 * Math.log(row.above / above) ** 2;
  const near = [...data.study].sort((a, b) => far(a) - far(b)).slice(0, 3);
  byId("times").textContent = `This log holds ${digits(times, 2)} correlation times; at low frequencies the bias is ${digits(above, 2)} times the white noise. Of the simulated study, the nearest:`;
  table("study", ["simulated sensor", "length", "correlation times in the log", "bias over white noise", "logs that resolve T_c"],
    near.map((r) => [r.title, hoursWords(r.hours), digits(r.times, 2), digits(r.above, 2), `${digits(100 * r.resolved, 2)} % of ${r.logs}`]));
}

byId("key").append(
  ...[["this sensor", BLUE], ["curves of 95 of 100 logs", "#b9d4ec"], ["its terms", GREY], ["your log, 95 %", OWN]].map(([name, colour]) =>
    made("span", {}, made("i", { style: `background:${colour}` }), name)),
);
byId("inputs").addEventListener("submit", (event) => event.preventDefault());
for (const radio of document.querySelectorAll("input[name=kind]")) {
  radio.addEventListener("change", () => {
    own = null;
    setKind();
    update();
  });
}
function restore() {
  const wanted = new URLSearchParams(location.hash.slice(1)).get("kind") === "accel" ? "accel" : "rate";
  if (wanted !== kind()) {
    document.querySelector(`input[name=kind][value=${wanted}]`).checked = true;
    setKind();
  }
  fromAddress(all);
  update();
}
addEventListener("hashchange", restore);
restore();
