// Plots that can be zoomed and moved, on a canvas: no library, nothing from the net.
//
//   new Plot(element, {series, equal, height, title, x, y, log, seconds, group, hover})
//
// A series is {x, y, colour, kind}: kind "line" (null breaks it, and so does half a `turn`), "steps",
// "dots", "crosses", "band" with {x, low, high}, "marks" with {shape, x_low ...} for error bars,
// "field" with {xs, ys, z, levels, colours} for filled contours, or "bars" with {from, to, row,
// colours, rows}. `x` and `y` label the axes; `log` is "x", "y" or "xy". Plots of one `group` (an
// array) share their x axis. `hover(i)` is told which of `points` lies nearest to the pointer;
// `mark(i)` shows it in another plot; `tip(i)` says in words what lies there. A plot with `drag(x, y)`
// does not move: a press, a drag and the arrow keys choose a place in it; nor does one that is `fixed`,
// where the arrow keys go from point to point.
"use strict";

class Plot {
  constructor(element, options) {
    Object.assign(this, { equal: false, height: 220, group: [], log: "", hover: () => {}, over: () => {} }, options);
    this.element = element;
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.say(this.title);
    this.canvas.style.cssText = `display:block;width:100%;height:${this.height}px;touch-action:${this.equal || this.drag ? "none" : "pan-y"}`;
    element.append(this.canvas);
    if (this.tip) {
      element.style.position = "relative";
      this.note = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
      this.note.setAttribute("role", "status");
      element.append(this.note);
    }
    this.pointers = new Map();
    this.group.push(this);
    this.reset();
    const on = (name, what) => this.canvas.addEventListener(name, what.bind(this), { passive: false });
    on("wheel", this.wheel);
    on("pointerdown", this.down);
    on("pointermove", this.move);
    for (const name of ["pointerup", "pointercancel"]) on(name, this.up);
    on("pointerleave", (event) => event.pointerType === "mouse" && this.at(null));
    on("dblclick", () => this.drag || this.fixed || this.whole());
    on("keydown", this.key);
    new ResizeObserver(() => requestAnimationFrame(() => this.draw())).observe(element);
    addEventListener("beforeprint", () => this.draw(3));
    addEventListener("afterprint", () => this.draw());
  }

  // What a reader who does not see the plot is told of it.
  say(words) {
    const keys = this.drag ? "arrow keys move the point" : this.fixed ? "arrow keys read its points" : "arrow keys move, plus and minus zoom, 0 shows the whole";
    this.canvas.setAttribute("aria-label", `${words}; ${keys}`);
  }

  show(series) {
    this.series = series;
    this.draw();
  }

  // The part of the plane that is shown: in logarithms along an axis that has them -------------

  u(x) {
    return this.log.includes("x") ? Math.log10(x) : x;
  }

  v(y) {
    return this.log.includes("y") ? Math.log10(y) : y;
  }

  reset() {
    let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
    const has = (x, y) => {
      const [u, v] = [this.u(x), this.v(y)];
      if (x === null || y === null || !isFinite(u) || !isFinite(v)) return;
      [x0, x1, y0, y1] = [Math.min(x0, u), Math.max(x1, u), Math.min(y0, v), Math.max(y1, v)];
    };
    for (const s of this.series) {
      if (s.kind === "bars") {
        for (const x of [...s.from, ...s.to]) [x0, x1] = [Math.min(x0, x), Math.max(x1, x)];
        [y0, y1] = [0, s.rows.length];
        continue;
      }
      for (const y of [s.y, s.low, s.high]) if (y) s.x.forEach((x, i) => has(x, y[i]));
    }
    if (this.span) [x0, x1] = this.span.map((x) => this.u(x));
    if (!(x1 >= x0)) [x0, x1] = [0, 1];
    if (!(y1 >= y0)) [y0, y1] = [0, 1];
    const bars = this.series.some((s) => s.kind === "bars");
    const least = this.equal ? 5 : 1e-6;
    const wide = Math.max(x1 - x0, least), high = Math.max(y1 - y0, this.equal ? 5 : this.least || 1e-6);
    const [cx, cy] = [(x0 + x1) / 2, (y0 + y1) / 2], edge = this.equal ? 0.55 : 0.5;
    this.view = { x0: cx - wide * edge, x1: cx + wide * edge };
    Object.assign(this.view, bars ? { y0, y1 } : { y0: cy - high * 0.56, y1: cy + high * 0.56 });
    if (this.range) Object.assign(this.view, { y0: this.v(this.range[0]), y1: this.v(this.range[1]) });
  }

  whole() {
    for (const plot of this.group) plot.reset();
    this.changed();
  }

  changed() {
    for (const plot of this.group) {
      if (plot !== this) Object.assign(plot.view, { x0: this.view.x0, x1: this.view.x1 });
      plot.draw();
    }
    this.over();
  }

  zoom(factor, px, py) {
    const v = this.view, x = this.u(this.toX(px)), y = this.v(this.toY(py));
    if ((v.x1 - v.x0) * factor < (this.equal ? 0.2 : 0.1)) return;
    [v.x0, v.x1] = [x + (v.x0 - x) * factor, x + (v.x1 - x) * factor];
    if (this.equal) [v.y0, v.y1] = [y + (v.y0 - y) * factor, y + (v.y1 - y) * factor];
    this.changed();
  }

  pan(dx, dy) {
    const v = this.view, x = dx / this.scaleX(), y = this.equal ? dy / this.scaleY() : 0;
    [v.x0, v.x1, v.y0, v.y1] = [v.x0 - x, v.x1 - x, v.y0 + y, v.y1 + y];
    this.changed();
  }

  // Pixels and numbers -----------------------------------------------------------------------

  frame() {
    const width = this.canvas.clientWidth, left = (this.left || (this.equal ? 0 : 46)) + (this.y ? 18 : 0), top = 4;
    const below = this.equal ? 4 : this.x ? 42 : 24;
    return { left, top, width: Math.max(width - left - 4, 20), height: this.height - below - top };
  }

  scaleX() {
    const f = this.frame(), v = this.view, s = f.width / (v.x1 - v.x0);
    return this.equal ? Math.min(s, f.height / (v.y1 - v.y0)) : s;
  }

  scaleY() {
    return this.equal ? this.scaleX() : this.frame().height / (this.view.y1 - this.view.y0);
  }

  px(x) {
    const f = this.frame(), v = this.view;
    return f.left + f.width / 2 + (this.u(x) - (v.x0 + v.x1) / 2) * this.scaleX();
  }

  py(y) {
    const f = this.frame(), v = this.view;
    return f.top + f.height / 2 - (this.v(y) - (v.y0 + v.y1) / 2) * this.scaleY();
  }

  toX(px) {
    const u = (this.view.x0 + this.view.x1) / 2 + (px - this.frame().left - this.frame().width / 2) / this.scaleX();
    return this.log.includes("x") ? 10 ** u : u;
  }

  toY(py) {
    const v = (this.view.y0 + this.view.y1) / 2 - (py - this.frame().top - this.frame().height / 2) / this.scaleY();
    return this.log.includes("y") ? 10 ** v : v;
  }

  // Pointer and keys -------------------------------------------------------------------------

  wheel(event) {
    if (this.drag || this.fixed) return;
    if (!event.ctrlKey && !event.metaKey && !this.equal && document.activeElement !== this.canvas) return;
    event.preventDefault();
    this.zoom(Math.exp(Math.sign(event.deltaY) * 0.2), event.offsetX, event.offsetY);
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
    if (this.drag) this.drag(this.toX(event.offsetX), this.toY(event.offsetY));
    this.point(event);
  }

  move(event) {
    const was = this.pointers.get(event.pointerId), now = { x: event.offsetX, y: event.offsetY };
    if (!was) return this.point(event);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
    this.pointers.set(event.pointerId, now);
    if (this.drag) return this.drag(this.toX(now.x), this.toY(now.y));
    if (this.fixed) return this.point(event);
    if (!others.length) return this.pan(now.x - was.x, now.y - was.y);
    const apart = (a, b) => Math.max(Math.hypot(a.x - b.x, a.y - b.y), 20), other = others[0];
    this.zoom(apart(was, other) / apart(now, other), (now.x + other.x) / 2, (now.y + other.y) / 2);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
  }

  key(event) {
    const [w, h] = [this.canvas.clientWidth / 2, this.height / 2], step = 40;
    const moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (this.drag) {
      if (!moves[event.key] || !this.place) return;
      const [x, y] = this.place, [dx, dy] = moves[event.key];
      this.drag(this.toX(this.px(x) - dx / 10), this.toY(this.py(y) - dy / 10));
    } else if (this.fixed) {
      const last = (this.points?.x.length ?? 0) - 1, by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!by || last < 0) return;
      this.at(Math.min(Math.max((this.marked ?? -1) + by, 0), last));
    } else if (moves[event.key]) this.pan(...moves[event.key]);
    else if ("+=".includes(event.key)) this.zoom(1 / 1.4, w, h);
    else if (event.key === "-") this.zoom(1.4, w, h);
    else if (event.key === "0") this.whole();
    else return;
    event.preventDefault();
  }

  point(event) {
    const [x, y] = [event.offsetX, event.offsetY];
    const s = this.points, plane = this.equal || this.drag;
    let best = null, least = plane ? 900 : Infinity;
    if (!s) return;
    for (let i = 0; i < s.x.length; i++) {
      if (s.x[i] === null || (plane && s.y[i] === null) || s.only?.(i) === false) continue;
      const dx = this.px(s.x[i]) - x, dy = plane ? this.py(s.y[i]) - y : 0, far = dx * dx + dy * dy;
      if (far < least) [best, least] = [i, far];
    }
    this.at(best);
  }

  at(i) {
    this.hover(i);
    if (this.fixed) this.mark(i);
    if (!this.note) return;
    this.note.hidden = i === null;
    if (i === null) return;
    this.note.textContent = this.tip(i);
    const x = this.px(this.points.x[i]), y = this.py(this.points.y[i]), right = x > this.canvas.clientWidth / 2;
    this.note.style.cssText = `top:${Math.max(y - 12, 0)}px;` + (right ? `right:${this.canvas.clientWidth - x + 12}px` : `left:${x + 12}px`);
  }

  // Drawing ----------------------------------------------------------------------------------

  draw(sharper = 1) {
    const c = this.canvas, ratio = Math.max(window.devicePixelRatio || 1, sharper);
    const [w, h] = [Math.round(c.clientWidth * ratio), Math.round(this.height * ratio)];
    if (!w) return;
    if (c.width !== w || c.height !== h) [c.width, c.height] = [w, h];
    const g = (this.pen = c.getContext("2d")), f = this.frame();
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, c.clientWidth, this.height);
    g.font = "12px system-ui, sans-serif";
    g.lineJoin = "round";
    if (!this.equal) this.axes(g, f);
    g.save();
    g.beginPath();
    g.rect(f.left, f.top, f.width, f.height);
    g.clip();
    for (const s of this.series) this[s.kind](g, s);
    if (this.also) this.also(g);
    if (this.marked !== null && this.marked !== undefined) this.cursor(g, f);
    g.restore();
    g.strokeStyle = "#888";
    g.strokeRect(f.left + 0.5, f.top + 0.5, f.width - 1, f.height - 1);
    if (this.equal) this.bar(g, f);
  }

  mark(i) {
    this.marked = i;
    this.draw();
  }

  cursor(g, f) {
    const s = this.points, i = this.marked;
    if (!s || s.x[i] === null) return;
    g.strokeStyle = g.fillStyle = "#000";
    if (!this.equal) {
      g.fillRect(this.px(s.x[i]) - 0.5, f.top, 1, f.height);
    } else if (s.y[i] !== null) {
      g.lineWidth = 2;
      g.beginPath();
      g.arc(this.px(s.x[i]), this.py(s.y[i]), 6, 0, 7);
      g.stroke();
      g.lineWidth = 1;
    }
  }

  axes(g, f) {
    const v = this.view, bars = this.series.find((s) => s.kind === "bars");
    g.textBaseline = "middle";
    g.fillStyle = "#333";
    g.strokeStyle = "#e2e2e2";
    g.textAlign = "right";
    if (bars) {
      bars.rows.forEach((name, row) => g.fillText(name, f.left - 5, this.py(bars.rows.length - row - 0.5)));
    } else {
      for (const [y, text] of this.ticks("y", f.height / 38)) {
        g.strokeRect(f.left, this.py(y), f.width, 0);
        g.fillText(text, f.left - 5, this.py(y));
      }
    }
    g.textAlign = "center";
    for (const [x, text] of this.ticks("x", f.width / 85)) {
      if (!bars) g.strokeRect(this.px(x), f.top, 0, f.height);
      const half = g.measureText(text).width / 2;
      const at = Math.min(Math.max(this.px(x), f.left + half), f.left + f.width - half);
      g.fillText(text, at, f.top + f.height + 12);
    }
    if (this.x) g.fillText(this.x, f.left + f.width / 2, f.top + f.height + 32);
    if (!this.y) return;
    g.save();
    g.translate(8, f.top + f.height / 2);
    g.rotate(-Math.PI / 2);
    g.fillText(this.y, 0, 0);
    g.restore();
  }

  // Where an axis has a line, and what is written there.
  ticks(axis, count) {
    const low = this.view[axis + "0"], high = this.view[axis + "1"];
    if (!this.log.includes(axis)) {
      const written = axis === "x" && this.seconds ? clock : short;
      return ticks(low, high, count, axis === "x" && this.seconds).map((at) => [at, written(at)]);
    }
    const every = Math.max(Math.ceil((high - low) / count), 1), found = [];
    for (let k = Math.floor(low); k <= high; k++) {
      for (const m of high - low < count / 3 ? [1, 2, 5] : [1]) {
        const at = m * 10 ** k;
        if (Math.log10(at) < low - 1e-9 || Math.log10(at) > high + 1e-9) continue;
        found.push([at, k % every ? "" : m === 1 && Math.abs(k) > 4 ? "10" + raised(k) : short(at)]);
      }
    }
    return found;
  }

  bar(g, f) {
    const most = (f.width * 0.3) / this.scaleX(), ten = 10 ** Math.floor(Math.log10(most));
    const metres = [5, 2, 1].map((k) => k * ten).find((m) => m <= most), wide = metres * this.scaleX();
    const [x, y] = [f.left + 12, f.top + f.height - 12];
    g.fillStyle = "#fffc";
    g.fillRect(x - 6, y - 22, wide + 12, 28);
    g.fillStyle = "#222";
    g.fillRect(x, y - 2, wide, 3);
    g.textAlign = "left";
    g.textBaseline = "bottom";
    g.fillText(metres >= 1000 ? short(metres / 1000) + " km" : short(metres) + " m", x, y - 4);
    g.fillText("N ↑", f.left + f.width - 30, f.top + 20);
  }

  line(g, s, steps = false) {
    g.strokeStyle = s.colour;
    g.lineWidth = s.width || 1.6;
    g.setLineDash(s.dash || []);
    g.beginPath();
    let pen = false, last = 0;
    for (let i = 0; i < s.x.length; i++) {
      if (s.x[i] === null || s.y[i] === null || s.only?.(i) === false) {
        pen = false;
        continue;
      }
      const [x, y] = [this.px(s.x[i]), this.py(s.y[i])];
      if (s.turn && pen && Math.abs(y - last) > (s.turn / 2) * this.scaleY()) pen = false;
      if (steps && pen) g.lineTo(x, last);
      if (pen) g.lineTo(x, y);
      else g.moveTo(x, y);
      [pen, last] = [true, y];
    }
    g.stroke();
    g.setLineDash([]);
    g.lineWidth = 1;
  }

  band(g, s) {
    const known = s.x.map((_, i) => i).filter((i) => s.low[i] !== null && s.high[i] !== null);
    g.fillStyle = s.colour;
    g.beginPath();
    for (const i of known) g.lineTo(this.px(s.x[i]), this.py(s.high[i]));
    for (const i of known.reverse()) g.lineTo(this.px(s.x[i]), this.py(s.low[i]));
    g.fill();
  }

  marks(g, s) {
    const size = s.size || 5;
    for (let i = 0; i < s.x.length; i++) {
      if (s.x[i] === null || s.y[i] === null) continue;
      const [x, y] = [this.px(s.x[i]), this.py(s.y[i])], end = (of, at) => (s[of]?.[i] ? this[of[0] === "x" ? "px" : "py"](s[of][i]) : at);
      for (const [colour, width] of [["#fff", 4], [s.colour, 2]]) {
        g.strokeStyle = g.fillStyle = colour;
        g.lineWidth = width;
        g.beginPath();
        g.moveTo(end("x_low", x), y);
        g.lineTo(end("x_high", x), y);
        g.moveTo(x, end("y_low", y));
        g.lineTo(x, end("y_high", y));
        g.stroke();
        g.beginPath();
        if (s.shape === "target") {
          g.arc(x, y, size + 2, 0, 7);
          for (const [a, b] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
            g.moveTo(x + a * size * 0.4, y + b * size * 0.4);
            g.lineTo(x + a * size * 2.4, y + b * size * 2.4);
          }
        } else if (s.shape === "square") g.rect(x - size, y - size, 2 * size, 2 * size);
        else g.arc(x, y, size, 0, 7);
        if (s.shape === "ring" && colour !== "#fff") {
          g.save();
          g.fillStyle = "#fff";
          g.fill();
          g.restore();
        } else if (s.shape !== "target" && colour !== "#fff") g.fill();
        g.stroke();
      }
    }
    g.lineWidth = 1;
  }

  // A table z[j][i] over xs and ys, evenly spaced on the plot: filled between levels, lines at them.
  // It is painted once for each table and size.
  field(g, s) {
    const f = this.frame(), [w, h] = [f.width, f.height].map((x) => Math.round((x * this.canvas.width) / this.canvas.clientWidth));
    if (this.painted?.z !== s.z || this.painted.width !== w || this.painted.height !== h) {
      const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h }), pen = canvas.getContext("2d");
      pen.scale(w / f.width, h / f.height);
      pen.translate(-f.left, -f.top);
      pen.font = g.font;
      this.contours(pen, s);
      this.painted = { z: s.z, width: w, height: h, canvas };
    }
    g.drawImage(this.painted.canvas, f.left, f.top, f.width, f.height);
  }

  contours(g, s) {
    const [nx, ny] = [s.xs.length, s.ys.length], left = this.px(s.xs[0]), low = this.py(s.ys[0]);
    const wide = (this.px(s.xs[nx - 1]) - left) / (nx - 1), high = (this.py(s.ys[ny - 1]) - low) / (ny - 1);
    const block = 2;
    for (let x = 0; x < wide * (nx - 1); x += block) {
      for (let y = 0; y > high * (ny - 1); y -= block) {
        const [a, b] = [(x + block / 2) / wide, (y - block / 2) / high], i = Math.min(Math.floor(a), nx - 2), j = Math.min(Math.floor(b), ny - 2);
        const [p, q] = [a - i, b - j];
        const z = (s.z[j][i] * (1 - p) + s.z[j][i + 1] * p) * (1 - q) + (s.z[j + 1][i] * (1 - p) + s.z[j + 1][i + 1] * p) * q;
        g.fillStyle = s.colours[s.levels.filter((level) => z >= level).length];
        g.fillRect(left + x, low + y - block, block + 0.5, block + 0.5);
      }
    }
    g.strokeStyle = "#333";
    const named = [];
    s.levels.forEach((level, k) => {
      let [name, best] = [null, Infinity];
      g.beginPath();
      for (let j = 0; j < ny - 1; j++) {
        for (let i = 0; i < nx - 1; i++) {
          const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], ends = [];
          corners.forEach(([a, b], n) => {
            const [c, d] = corners[(n + 1) % 4], [from, to] = [s.z[b][a] - level, s.z[d][c] - level];
            if (from < 0 === to < 0) return;
            const t = from / (from - to);
            ends.push([left + (a + t * (c - a)) * wide, low + (b + t * (d - b)) * high]);
          });
          for (let n = 0; n + 1 < ends.length; n += 2) {
            g.moveTo(...ends[n]);
            g.lineTo(...ends[n + 1]);
            // Its label goes where a line runs across on the left or up near the bottom, off the edges.
            const [a, b] = [i / nx, j / ny], edge = Math.min(a, 1 - a, b, 1 - b) < 0.06;
            const far = Math.min(Math.abs(a - 0.16), Math.abs(b - 0.12) + 0.05) + edge;
            if (far < best) [name, best] = [ends[n], far];
          }
        }
      }
      g.stroke();
      if (!name || named.some(([x, y]) => Math.abs(x - name[0]) < 44 && Math.abs(y - name[1]) < 15)) return;
      named.push(name);
      const text = s.names[k], half = g.measureText(text).width / 2 + 2;
      const at = Math.max(name[0], left + half + 2);
      g.fillStyle = "#fff";
      g.fillRect(at - half, name[1] - 7, 2 * half, 14);
      g.fillStyle = "#000";
      g.textAlign = "center";
      g.textBaseline = "middle";
      g.fillText(text, at, name[1]);
    });
  }

  steps(g, s) {
    this.line(g, s, true);
  }

  dots(g, s) {
    g.fillStyle = s.colour;
    const size = s.size || 2;
    for (let i = 0; i < s.x.length; i++) {
      if (s.x[i] === null || s.y[i] === null || s.only?.(i) === false) continue;
      g.fillRect(this.px(s.x[i]) - size / 2, this.py(s.y[i]) - size / 2, size, size);
    }
  }

  crosses(g, s) {
    g.strokeStyle = s.colour;
    g.beginPath();
    for (let i = 0; i < s.x.length; i++) {
      if (s.x[i] === null || s.y[i] === null || s.only?.(i) === false) continue;
      const [x, y] = [this.px(s.x[i]), this.py(s.y[i])];
      g.moveTo(x - 3, y - 3);
      g.lineTo(x + 3, y + 3);
      g.moveTo(x - 3, y + 3);
      g.lineTo(x + 3, y - 3);
    }
    g.stroke();
  }

  bars(g, s) {
    for (let i = 0; i < s.from.length; i++) {
      const [x, end] = [this.px(s.from[i]), this.px(s.to[i])], top = this.py(s.rows.length - s.row[i] - 0.12);
      g.fillStyle = s.colours[i];
      g.fillRect(x, top, Math.max(end - x, 1), 0.76 * this.scaleY());
    }
  }
}

// Round numbers between two ends, about so many; of time in steps of a clock.
function ticks(low, high, count, seconds = false) {
  const rough = (high - low) / Math.max(count, 1), ten = 10 ** Math.floor(Math.log10(rough));
  let step = [1, 2, 5, 10].map((k) => k * ten).find((s) => s >= rough);
  if (seconds && rough > 20) {
    const even = [30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
    step = even.find((s) => s >= rough) || 86400 * Math.ceil(rough / 86400);
  }
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

function raised(k) {
  return String(k).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
}

function short(x) {
  return String(Number(x.toPrecision(6))).replace("-", "−");
}

// Seconds as 12.5 s, 3:20 min or 1:05 h.
function clock(t) {
  const s = Math.abs(t), sign = t < 0 ? "−" : "", two = (x) => String(Math.floor(x)).padStart(2, "0");
  if (s < 60) return sign + short(s) + " s";
  if (s < 3600) return sign + Math.floor(s / 60) + ":" + two(s % 60) + (s % 1 ? (s % 1).toFixed(1).slice(1) : "") + " min";
  return sign + Math.floor(s / 3600) + ":" + two((s % 3600) / 60) + (s % 60 ? ":" + two(s % 60) : "") + " h";
}
