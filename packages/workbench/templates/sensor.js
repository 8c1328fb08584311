// What the explorers share: quantities with a slider, a number and a unit; a model.json; the address.
//
// Values are kept in one base unit each (deg, s, g) and shown in the unit that is chosen. Nothing is
// sent: a file is read by the page itself, and the address after # holds the numbers.
"use strict";

const DEGREE = 180 / Math.PI, G = 9.80665;
// Factor from the base unit; the first of a list is shown first.
const GYRO = {
  N: { "°/√h": 60, "°/√s": 1, "m°/s/√Hz": 1e3 },
  B: { "°/h": 3600, "°/s": 1, "m°/s": 1e3 },
  K: { "°/h/√h": 3600 * 60, "°/s/√s": 1 },
  D: { "°/h/h": 3600 * 3600, "°/s/h": 3600, "°/s/s": 1 },
};
const ACCEL = {
  N: { "µg/√Hz": 1e6, "m/s/√h": 60 * G },
  B: { "µg": 1e6, "mg": 1e3, "m/s²": G },
  K: { "µg/√s": 1e6, "µg/√h": 6e7 },
  D: { "µg/h": 3.6e9, "µg/s": 1e6 },
};
const TIME = { s: 1, min: 1 / 60, h: 1 / 3600 };
// Units of a channel in a model.json, in base units.
const IN_BASE = { "deg/s": 1, "rad/s": DEGREE, "deg/h": 1 / 3600, g: 1, mg: 1e-3, "m/s^2": 1 / G };

const sound = (v) => (typeof v === "number" && isFinite(v) && v > 0 ? v : null);
const byId = (id) => document.getElementById(id);

function made(name, settings = {}, ...children) {
  const { className, textContent, ...others } = settings, node = document.createElement(name);
  if (className) node.className = className;
  if (textContent !== undefined) node.textContent = textContent;
  for (const [key, value] of Object.entries(others)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// A table of rows; a cell is a text, or a node.
function table(id, head, rows) {
  const cell = (content, i) => made("td", { "data-of": i ? head[i] : "" }, content);
  const top = made("tr", {}, ...head.map((text) => made("th", { scope: "col", textContent: text })));
  const body = rows.map((row) => made("tr", {}, ...row.map(cell)));
  byId(id).replaceChildren(made("thead", {}, top), made("tbody", {}, ...body));
}

// A number in so many digits, without an exponent: 0.00012, 1.2×10⁷.
function digits(x, count = 3) {
  if (!isFinite(x)) return "–";
  const [mantissa, power] = Number(x).toExponential(count - 1).split("e").map(Number);
  if (power >= -6 && power < 7) return String(Number(x.toPrecision(count))).replace("-", "−");
  return `${mantissa}×10${raised(power)}`;
}

// With the zeros that belong to it: 0.30, 12, 120.
function rounded(x, count = 2) {
  return x >= 10 ** (count - 1) && isFinite(x) ? digits(x, count) : isFinite(x) ? Number(x).toPrecision(count) : "–";
}

// One quantity: label, slider (in logarithms), number and unit. `least` and `most` bound the slider,
// `refuse(value)` says in a sentence why a number outside is not taken, or null.
class Quantity {
  constructor(place, { id, name, symbol, units, value, least, most, off = false, refuse = () => null, changed }) {
    Object.assign(this, { id, name, symbol, units, value, least, most, off, refuse, changed, wrong: null });
    this.unit = Object.keys(units)[0];
    const label = made("label", { for: id, textContent: name });
    this.slider = made("input", { type: "range", min: 0, max: 1000, step: 1, "aria-label": `${symbol}, slider` });
    this.number = made("input", { type: "text", inputmode: "decimal", id, autocomplete: "off" });
    this.choice = made("select", { "aria-label": `unit of ${symbol}` }, ...Object.keys(units).map((u) => made("option", { textContent: u })));
    this.said = made("p", { className: "wrong", id: `${id}-wrong`, role: "alert" });
    this.number.setAttribute("aria-describedby", this.said.id);
    place.append(made("div", { className: "quantity" }, label, this.slider, this.number, this.choice, this.said));
    this.slider.addEventListener("input", () => this.set(this.fromSlider(), true));
    this.number.addEventListener("change", () => this.type(this.number.value));
    this.choice.addEventListener("change", () => {
      this.unit = this.choice.value;
      this.set(this.value, true);
    });
    this.show();
  }

  // Another unit and range, as of an accelerometer in place of a gyro.
  renew(units, value, least, most) {
    Object.assign(this, { units, least, most });
    this.unit = Object.keys(units)[0];
    this.choice.replaceChildren(...Object.keys(units).map((u) => made("option", { textContent: u })));
    this.set(value);
  }

  // With `off`, the left end of the slider is zero: the term is absent.
  fromSlider() {
    const at = Number(this.slider.value) / 1000;
    if (this.off && at === 0) return 0;
    return Number((this.least * (this.most / this.least) ** at).toPrecision(4));
  }

  type(text) {
    const x = Number(text.trim().replace(",", ".").replace("−", "-"));
    if (/^[1-9]\d{0,2},\d{3}$/.test(text.trim())) { // a comma of thousands, or of decimals
      return this.refused(`${this.symbol}: '${text}' may be ${text.replace(",", "")} or ${x}; write it without a comma.`);
    }
    if (text.trim() === "" || !isFinite(x) || x < 0 || (x === 0 && !this.off)) {
      return this.refused(`${this.symbol}: '${text}' is no number above zero${this.off ? " (0 leaves the term out)" : ""}.`);
    }
    this.set(x / this.units[this.unit], true);
  }

  refused(why) {
    this.wrong = why;
    this.said.textContent = why;
    this.number.setAttribute("aria-invalid", "true");
    this.changed();
  }

  set(value, tell = false) {
    this.value = value;
    this.wrong = this.refuse(value);
    this.show();
    if (tell) this.changed();
  }

  show() {
    const share = this.value > 0 ? Math.log(this.value / this.least) / Math.log(this.most / this.least) : 0;
    this.slider.value = Math.round(1000 * Math.min(Math.max(share, 0), 1));
    this.slider.setAttribute("aria-valuetext", this.words());
    this.number.value = Number((this.value * this.units[this.unit]).toPrecision(5));
    this.choice.value = this.unit;
    this.said.textContent = this.wrong || "";
    if (this.wrong) this.number.setAttribute("aria-invalid", "true");
    else this.number.removeAttribute("aria-invalid");
  }

  words(value = this.value, count = 4) {
    return value ? `${digits(value * this.units[this.unit], count)} ${this.unit}` : "none";
  }
}

// A model.json, chosen or dropped; `take(model, name)` may refuse it by throwing a sentence.
function takeModels(place, take) {
  const input = made("input", { type: "file", accept: ".json,application/json", id: "model-file" });
  const said = made("p", { id: "model-said", role: "status" });
  place.append(made("label", { for: "model-file", textContent: "Your sensor: a model.json (choose it, or drop it on the page)" }), input, said);
  const read = async (file) => {
    said.className = "";
    try {
      if (file.size > 2e7) throw new Error("it is larger than 20 MB, and no model.json is");
      let model;
      try {
        model = JSON.parse(await file.text());
      } catch (error) {
        throw new Error(`it is no JSON (${error.message})`);
      }
      const channels = model && model.channels, isObject = (v) => v !== null && typeof v === "object" && !Array.isArray(v);
      const sound = (c) => isObject(c) && typeof c.name === "string" && isObject(c.parameters) && Object.values(c.parameters).every(isObject);
      if (!Array.isArray(channels) || !channels.length || !channels.every(sound)) {
        throw new Error("it has no channels with parameters, as `python -m analysis report LOG --out DIR` writes them to DIR/model.json");
      }
      said.textContent = take(model, file.name);
    } catch (error) {
      said.className = "wrong";
      said.textContent = `${file.name} is not taken: ${error.message}.`;
    }
  };
  input.addEventListener("change", () => {
    if (input.files.length) read(input.files[0]);
    input.value = ""; // so that the same file can be chosen again after a change
  });
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files.length) read(event.dataTransfer.files[0]);
  });
}

// The numbers of the page in its address, so that a state can be kept as a link, and in the link to
// the other page, which may call them otherwise.
function keepInAddress(quantities, others, there) {
  const written = (numbers) => Object.entries(numbers).map(([name, x]) => `${name}=${typeof x === "number" ? Number(x.toPrecision(5)) : encodeURIComponent(x)}`).join("&");
  history.replaceState(null, "", `#${written({ ...Object.fromEntries(quantities.map((q) => [q.id, q.value])), ...others })}`);
  const link = byId("other");
  link.href = `${link.href.split("#")[0]}#${written(there)}`;
}

function fromAddress(quantities) {
  const given = new URLSearchParams(location.hash.slice(1));
  for (const q of quantities) {
    const x = Number(given.get(q.id));
    if (given.has(q.id) && isFinite(x) && (x > 0 || (q.off && x === 0))) q.set(x);
  }
  return given;
}

// Monotone cubic through points of rising x, as scipy's PchipInterpolator.
function pchip(x, y, at) {
  const n = x.length, h = [], m = [], d = new Array(n).fill(0);
  for (let k = 0; k < n - 1; k++) [h[k], m[k]] = [x[k + 1] - x[k], (y[k + 1] - y[k]) / (x[k + 1] - x[k])];
  const end = (h0, h1, m0, m1) => {
    const slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
    if (Math.sign(slope) !== Math.sign(m0)) return 0;
    return Math.sign(m0) !== Math.sign(m1) && Math.abs(slope) > 3 * Math.abs(m0) ? 3 * m0 : slope;
  };
  for (let k = 1; k < n - 1; k++) {
    if (m[k - 1] * m[k] <= 0) continue;
    const [a, b] = [2 * h[k] + h[k - 1], h[k] + 2 * h[k - 1]];
    d[k] = (a + b) / (a / m[k - 1] + b / m[k]);
  }
  [d[0], d[n - 1]] = [end(h[0], h[1], m[0], m[1]), end(h[n - 2], h[n - 3], m[n - 2], m[n - 3])];
  let k = 0;
  while (k < n - 2 && at > x[k + 1]) k++;
  const t = at - x[k], c = (3 * m[k] - 2 * d[k] - d[k + 1]) / h[k], b = (d[k] - 2 * m[k] + d[k + 1]) / h[k] ** 2;
  return y[k] + t * (d[k] + t * (c + t * b));
}
