// One picture of a run: ground, trails, links, points, forces.

// M. Okabe, K. Ito (2008): distinct for the colour blind.
const COLOURS = {
  light: ["#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9"],
  dark: ["#4db2ef", "#ff9152", "#35cfa3", "#f5bd4f", "#e6a3ca", "#8fd4fb"],
};
const MANY = 12;

// The name of a member as it is written: p₁ for p.1, and p₁,₂ for p.1.2.
function withSubscripts(name) {
  return name.replace(/(?:\.\d+)+(?![^.])/g, (found) => found.slice(1).replaceAll(".", ",")
    .replace(/\d/g, (digit) => "₀₁₂₃₄₅₆₇₈₉"[digit]));
}

// The area of corners in a plane, of such that go round against the clock where y runs up.
function area(corners) {
  return corners.reduce((sum, [x, y], k) => {
    const [u, v] = corners[(k + 1) % corners.length];
    return sum + 0.5 * (x * v - y * u);
  }, 0);
}

function areaInSpace(corners) {
  return Math.hypot(...[[0, 1], [1, 2], [2, 0]].map(([a, b]) => area(corners.map((p) => [p[a], p[b]]))));
}

class Drawing {
  // `one`: the number of the colour that all points have, where several runs share a view.
  constructor(canvas, run, view, one = null) {
    Object.assign(this, {canvas, run, view, one});
    this.pen = canvas.getContext("2d");
    const moving = run.moving.length;
    this.colours = new Map(run.moving.map((k, n) => [k, n]));
    this.shaded = moving > COLOURS.light.length;
    const linked = new Set(), grounds = new Set();
    for (const {ends: [a, b]} of run.links) {
      const still = run.points[a].fixed && run.points[b].fixed;
      for (const end of [a, b]) (still ? grounds : linked).add(end);
    }
    // Shapes that move have the colours of their points, or the next ones.
    const bodies = run.shapes.filter((shape) => shape.faces.length || shape.radius);
    const carried = new Set(bodies.map((shape) => shape.point));
    const own = run.shapes.filter((shape) => shape.moves && !this.colours.has(shape.point));
    // Fixed points on a ground need no support of their own.
    const walls = run.shapes.filter((shape) => shape.kind === "ground" && shape.corners.fixed);
    const based = new Set();
    for (const {corners: {fixed}} of view.space ? [] : walls) for (let k = 0; k + 3 < fixed.length; k += 2) {
      const [a, b, c, d] = fixed.slice(k, k + 4), long = Math.hypot(c - a, d - b);
      run.points.forEach(({fixed: at}, n) => {
        if (at && Math.hypot(at[0] - a, at[1] - b) + Math.hypot(at[0] - c, at[1] - d) < (1 + 1e-6) * long) based.add(n);
      });
    }
    Object.assign(this, {linked, grounds, carried, own, based});
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.canvas;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    Object.assign(this.view, {width: Math.max(width, 1), height: Math.max(height, 1)});
    this.size = Math.min(this.view.width, this.view.height);
  }

  // The colour of a moving point; a chain goes from one hue to another.
  colour(k) {
    const n = this.colours.get(k);
    if (n === undefined) return this.ink.ground;
    if (this.one !== null) return COLOURS[this.theme][this.one % COLOURS[this.theme].length];
    if (!this.shaded) return COLOURS[this.theme][n];
    const hue = 205 - 185 * n / Math.max(1, this.colours.size - 1);
    return this.theme === "dark" ? `hsl(${hue} 75% 65%)` : `hsl(${hue} 72% 42%)`;
  }

  colourOf(shape) {
    const n = this.own.indexOf(shape), all = COLOURS[this.theme];
    if (n < 0 || this.one !== null) return this.colour(n < 0 ? shape.point : this.run.moving[0]);
    return all[(this.colours.size + n) % all.length];
  }

  draw(t, {trails, forces, names, glow, theme, ink}) {
    Object.assign(this, {theme, ink});
    const {pen, run, view} = this;
    if (!this.one) pen.clearRect(0, 0, view.width, view.height);
    pen.lineCap = pen.lineJoin = "round";
    const moment = run.moment(t);
    const places = run.points.map((_, k) => run.place(k, moment));
    const dots = places.map((place) => view.at(place));
    this.placed = run.shapes.map((shape) => this.seen(shape, moment));
    this.radius = Math.max(3, Math.min(11, this.size * (run.points.length > MANY ? 0.011 : 0.02)));
    if (view.space) this.base(places, dots); else if (!this.one) this.grid();
    if (trails) for (const k of run.moving) this.trail(k, t, trails);
    this.shapes();
    this.links(places, dots);
    this.marks(t, dots, glow);
    this.dots(dots);
    if (forces) this.forces(moment, dots);
    if (names) this.names(dots);
    if (view.space && !this.one) this.axes();
    return places;
  }

  line(points, close) {
    const {pen} = this;
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    if (close) pen.closePath();
  }

  // One more area of a path.
  round(corners) {
    corners.forEach(([x, y], k) => k ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y));
    this.pen.closePath();
  }

  // Lines at round places, clear of the numbers at the left and below.
  grid() {
    const {pen, view, ink} = this;
    const [left, top] = view.under(0, 0), [right, bottom] = view.under(view.width, view.height);
    const step = stepOf(110 / view.scale, 1);
    pen.lineWidth = 1;
    pen.strokeStyle = ink.grid;
    pen.fillStyle = ink.dim;
    pen.font = "11px system-ui, sans-serif";
    const unit = this.run.units.length;
    // The name of a run stands above its picture's corner.
    const first = this.canvas.previousElementSibling ? 34 : 0;
    pen.textBaseline = "alphabetic";
    pen.textAlign = "center";
    for (let k = Math.ceil(left / step); k * step <= right; k++) {
      const x = Math.round(view.at([k * step, 0])[0]) + 0.5;
      if (x <= 44) continue;
      this.line([[x, first], [x, view.height - 22]]);
      pen.stroke();
      const text = written(k * step, step), half = Math.max(24, pen.measureText(text).width / 2 + 2);
      if (x < view.width - half) pen.fillText(text, x, view.height - 6);
    }
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    for (let k = Math.ceil(bottom / step); k * step <= top; k++) {
      const y = Math.round(view.at([0, k * step])[1]) + 0.5;
      if (y < first || y >= view.height - 22) continue;
      this.line([[44, y], [view.width, y]]);
      pen.stroke();
      if (y > Math.max(first, 12)) pen.fillText(written(k * step, step), 7, y);
    }
    if (unit) pen.fillText(unit, 7, view.height - 9);
  }

  // The floor of a space, seen from above, and on it the shadows of what moves.
  base(places, dots) {
    const {pen, view, run, ink} = this, z = view.floor;
    if (z === null || view.raised <= 0) return;
    const step = view.step, [[left, right], [front, back]] = view.ground;
    pen.lineWidth = 1;
    if (!this.one) {
      const corners = [[left, front], [right, front], [right, back], [left, back]];
      pen.fillStyle = ink.floor;
      this.line(corners.map((place) => view.at([...place, z])), true);
      if (!view.flat) pen.fill();
      pen.strokeStyle = ink.faint;
      const across = (from, to) => { this.line([view.at([...from, z]), view.at([...to, z])]); pen.stroke(); };
      for (let k = 0; left + k * step <= right + 0.5 * step; k++)
        across([left + k * step, front], [left + k * step, back]);
      for (let k = 0; front + k * step <= back + 0.5 * step; k++)
        across([left, front + k * step], [right, front + k * step]);
    }
    if (view.flat) return;
    const shadow = (p) => view.at([p[0], p[1], z]);
    pen.strokeStyle = ink.ground;
    pen.globalAlpha = 0.5;
    pen.setLineDash([2, 4]);
    if (run.moving.length <= 4) for (const k of run.moving) {
      this.line([dots[k], shadow(places[k])]);
      pen.stroke();
    }
    pen.setLineDash([]);
    pen.globalAlpha = 1;
    pen.strokeStyle = pen.fillStyle = ink.shadow;
    pen.lineWidth = 3;
    for (const {ends: [i, j]} of run.links) {
      this.line([shadow(places[i]), shadow(places[j])]);
      pen.stroke();
    }
    this.shadows(shadow);
    for (const k of run.moving) {
      const [x, y] = shadow(places[k]);
      pen.beginPath();
      pen.ellipse(x, y, this.radius, this.radius * Math.max(0.2, Math.sin(view.raised)), 0, 0, 7);
      pen.fill();
    }
  }

  // What faces the floor, as one area.
  shadows(shadow) {
    const {pen, view} = this;
    if (!this.placed.length) return;
    pen.beginPath();
    for (const {shape, at, places} of this.placed) {
      if (shape.radius) {
        const [x, y] = shadow(at), r = shape.radius * view.scale;
        pen.moveTo(x + r, y);
        pen.ellipse(x, y, r, r * Math.sin(view.raised), 0, 0, 7);
      }
      for (const face of shape.faces) {
        const flat = face.map((k) => places[k]);
        // All go round in one direction.
        if (area(flat) < 0) { if (shape.faces.length > 1) continue; flat.reverse(); }
        this.round(flat.map(shadow));
      }
    }
    pen.fill();
  }

  trail(k, t, {from, fading}) {
    const {pen, run, view} = this;
    const path = run.path(k, Math.max(run.start, from), t).map((p) => view.at(p));
    pen.strokeStyle = this.colour(k);
    const pieces = fading ? 24 : 1, thin = run.moving.length > MANY ? 0.6 : 1;
    for (let n = 0; n < pieces; n++) {
      const age = (n + 1) / pieces;
      pen.globalAlpha = fading ? 0.75 * age * age : 0.45;
      pen.lineWidth = thin * (fading ? 0.8 + 1.8 * age : 1.3);
      const first = Math.floor(n / pieces * (path.length - 1));
      const last = Math.floor((n + 1) / pieces * (path.length - 1));
      pen.lineCap = "butt";
      pen.beginPath();
      let gap = true;
      for (let i = first; i <= last && i < path.length; i++) {
        const [x, y] = path[i];
        if (!Number.isFinite(x + y)) { gap = true; continue; }
        if (gap) pen.moveTo(x, y); else pen.lineTo(x, y);
        gap = false;
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
    pen.lineCap = "round";
  }

  // A shape in pixels: its corners, the faces in front, each with how much of it is seen.
  seen(shape, moment) {
    const {view, run} = this, {at, found: places} = run.corners(shape, moment);
    const dots = places.map((place) => view.at(place));
    const single = shape.faces.length === 1, front = [];
    const faces = shape.faces.flatMap((face, n) => {
      const turned = -area(face.map((k) => dots[k]));
      front[n] = single || turned > 0;
      if (!front[n]) return [];
      const whole = view.space ? areaInSpace(face.map((k) => places[k])) : Math.abs(turned);
      const near = face.reduce((sum, k) => sum + dots[k][2], 0) / face.length;
      return [{face, near, share: whole ? Math.min(1, Math.abs(turned) / (view.space ? whole * view.scale ** 2 : whole)) : 0}];
    });
    front[-1] = true;
    return {shape, at, places, dots, faces, front, middle: view.at(at)};
  }

  // From the farthest to the nearest: faces, with the edges of their shape on the last of
  // them; edges behind are dashed.
  shapes() {
    const parts = [];
    for (const one of this.placed) {
      const {shape, dots, middle} = one;
      if (!dots.every(([x, y]) => Number.isFinite(x + y)) && shape.kind !== "curve") continue;
      if (shape.radius) parts.push({one, near: middle[2], edges: true});
      const sorted = one.faces.sort((a, b) => a.near - b.near);
      // What is round is one area, or its flat parts would be seen.
      if (shape.seams.length && sorted.length) {
        const [{share}] = sorted, near = sorted[sorted.length - 1].near;
        parts.push({one, faces: sorted.map(({face}) => face), share, near, edges: true});
      } else sorted.forEach(({face, share, near}, n) =>
        parts.push({one, faces: [face], share, near, edges: n === sorted.length - 1}));
      if (!shape.radius && !sorted.length) parts.push({one, near: dots.length ? dots[0][2] : 0, edges: true});
    }
    parts.sort((a, b) => a.near - b.near);
    for (const part of parts) {
      this.fill(part);
      if (part.edges) this.edges(part.one);
    }
  }

  fill({one: {shape, dots, middle}, faces = [], share = 1}) {
    const {pen, view, ink} = this;
    if (!shape.radius && !faces.length) return;
    pen.beginPath();
    if (shape.radius) pen.arc(middle[0], middle[1], shape.radius * view.scale, 0, 7);
    for (const face of faces) this.round(face.map((k) => dots[k]));
    for (const [colour, alpha] of [[ink.card, 0.75], [this.colourOf(shape), 0.12 + 0.3 * share]]) {
      pen.fillStyle = colour;
      pen.globalAlpha = alpha;
      pen.fill();
    }
    pen.globalAlpha = 1;
  }

  edges({shape, dots, front, middle}) {
    const {pen, view} = this, colour = this.colourOf(shape);
    if (shape.kind === "ground") {
      for (const [i, j] of shape.edges) this.ground(dots[i], dots[j], true);
      return;
    }
    if (shape.kind === "arrow") {
      const [[x, y], [u, v]] = dots;
      if (Math.hypot(u - x, v - y) > 1.5) this.arrow(x, y, u, v, false, colour);
      return;
    }
    const seen = [], behind = [];
    for (const edge of shape.edges) {
      const [i, j, a, b] = edge;
      const ahead = shape.radius ? dots[i][2] + dots[j][2] >= 2 * middle[2] : front[a] || front[b];
      (ahead ? seen : behind).push(edge);
    }
    for (const edge of shape.seams) if (front[edge[2]] !== front[edge[3]]) seen.push(edge);
    pen.strokeStyle = colour;
    pen.lineWidth = 1.6;
    this.joined(dots, seen);
    if (shape.radius) {
      pen.beginPath();
      pen.arc(middle[0], middle[1], shape.radius * view.scale, 0, 7);
      pen.stroke();
    }
    pen.lineWidth = 1;
    pen.globalAlpha = 0.6;
    pen.setLineDash([3, 4]);
    this.joined(dots, behind);
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  // Edges as one path: dashes go on from one to the next.
  joined(dots, edges) {
    const {pen} = this;
    let last = -1;
    pen.beginPath();
    for (const [i, j] of edges) {
      const [[x, y], [u, v]] = [dots[i], dots[j]];
      if (!Number.isFinite(x + y + u + v)) continue;
      if (i !== last) pen.moveTo(x, y);
      pen.lineTo(u, v);
      last = j;
    }
    pen.stroke();
  }

  links(places, dots) {
    const {pen, run, ink} = this;
    for (const link of run.links) {
      const [i, j] = link.ends, a = dots[i], b = dots[j];
      if (![...a, ...b].every(Number.isFinite)) continue;
      if (run.points[i].fixed && run.points[j].fixed) { this.ground(a, b); continue; }
      pen.strokeStyle = ink.rod;
      pen.lineWidth = Math.max(1.5, Math.min(4, this.radius * 0.34));
      if (link.kind === "line") pen.lineWidth = 1;
      if (link.kind === "spring") this.spring(a, b, link);
      else if (link.kind === "string") this.string(a, b, link, places[i], places[j]);
      else if (link.kind === "damper") this.damper(a, b, link);
      else { this.line([a, b]); pen.stroke(); }
    }
  }

  // What joins two fixed points is ground: hatched below, or at the right of its direction.
  ground(a, b, right = false) {
    const {pen, ink} = this;
    pen.strokeStyle = ink.ground;
    pen.lineWidth = 2;
    this.line([a, b]);
    pen.stroke();
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (length < 1) return;
    const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    const side = right || ux >= 0 ? 1 : -1;
    pen.lineWidth = 1;
    for (let s = 8; s <= length; s += 9) {
      const x = a[0] + s * ux, y = a[1] + s * uy;
      this.line([[x, y], [x - 7 * ux - 7 * side * uy, y - 7 * uy + 7 * side * ux]]);
      pen.stroke();
    }
  }

  // A link whose length changes: a coil with as many turns at any length.
  spring(a, b, link) {
    const {pen, view} = this;
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (length < 1) return;
    const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    const usual = link.usual * view.scale;
    const turns = Math.max(5, Math.min(16, Math.round(usual / 15)));
    const wide = Math.max(3, Math.min(9, 0.055 * usual, 0.9 * this.radius));
    const lead = 0.1 * length, body = length - 2 * lead, forth = 0.5 * wide;
    const points = [a];
    for (let n = 0; n <= turns * 16; n++) {
      const phase = n / 16 * 2 * Math.PI;
      const s = lead + forth + (body - 2 * forth) * n / (turns * 16) - forth * Math.cos(phase);
      const w = wide * Math.sin(phase);
      points.push([a[0] + s * ux - w * uy, a[1] + s * uy + w * ux]);
    }
    points.push(b);
    pen.lineWidth = Math.max(1.2, Math.min(2, this.radius * 0.2));
    this.line(points);
    pen.stroke();
  }

  // A cylinder that is open towards b, with a piston in it.
  damper(a, b, link) {
    const {pen, view} = this, length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (length < 1) return;
    const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    const wide = Math.max(3, Math.min(9, 0.055 * link.usual * view.scale, 0.9 * this.radius));
    const at = (s, w) => [a[0] + s * length * ux - w * wide * uy, a[1] + s * length * uy + w * wide * ux];
    pen.lineWidth = Math.max(1.2, Math.min(2, this.radius * 0.2));
    for (const path of [
      [a, at(0.35, 0)], [at(0.65, 1), at(0.35, 1), at(0.35, -1), at(0.65, -1)],
      [at(0.5, 0.8), at(0.5, -0.8)], [at(0.5, 0), b],
    ]) { this.line(path); pen.stroke(); }
  }

  // A string hangs where its ends are nearer than it is long.
  string(a, b, link, from, to) {
    const {pen, view} = this;
    const apart = Math.hypot(...from.map((x, k) => x - to[k]));
    const slack = Math.sqrt(Math.max(0, link.longest ** 2 - apart ** 2));
    const sag = slack > 1e-3 * link.longest ? 0.86 * slack * view.scale : 0;
    pen.lineWidth = 1.6;
    pen.beginPath();
    pen.moveTo(a[0], a[1]);
    pen.quadraticCurveTo((a[0] + b[0]) / 2, (a[1] + b[1]) / 2 + sag, b[0], b[1]);
    pen.stroke();
  }

  dots(dots) {
    const {pen, run, view} = this;
    const order = dots.map((_, k) => k);
    if (view.space) order.sort((a, b) => dots[a][2] - dots[b][2]);
    else order.sort((a, b) => !run.points[a].fixed - !run.points[b].fixed);
    for (const k of order) {
      const [x, y] = dots[k];
      if (!Number.isFinite(x + y)) continue;
      if (run.points[k].fixed) { this.fixed(k, x, y); continue; }
      // A body is seen before its point.
      const radius = this.carried.has(k) ? Math.min(3, this.radius) : this.radius;
      pen.beginPath();
      pen.arc(x, y, radius, 0, 7);
      pen.fillStyle = this.colour(k);
      pen.fill();
      pen.lineWidth = 1.5;
      pen.strokeStyle = this.ink.card;
      pen.stroke();
      pen.beginPath();
      pen.arc(x - 0.3 * radius, y - 0.32 * radius, 0.28 * radius, 0, 7);
      pen.fillStyle = "rgba(255, 255, 255, .5)";
      pen.fill();
    }
  }

  // A support where something hangs on it or stands on it, else a small square.
  fixed(k, x, y) {
    const {pen, ink, view} = this, r = Math.max(3, 0.5 * this.radius);
    if (this.grounds.has(k)) return;
    pen.fillStyle = ink.ground;
    pen.strokeStyle = ink.ground;
    if (!this.linked.has(k) || view.space) {
      pen.fillRect(x - r, y - r, 2 * r, 2 * r);
      return;
    }
    if (this.based.has(k)) { this.pin(x, y, r); return; }
    const side = this.run.points[k].fixed[1] >= view.middle[1] ? -1 : 1;
    const [w, h] = [1.9 * r + 5, side * (2 * r + 6)];
    pen.lineWidth = 1.4;
    pen.globalAlpha = 0.45;
    this.line([[x, y], [x - 0.62 * w, y + h], [x + 0.62 * w, y + h]], true);
    pen.fill();
    pen.globalAlpha = 1;
    this.line([[x - w, y + h], [x + w, y + h]]);
    pen.stroke();
    pen.lineWidth = 1;
    for (let s = -w + 2; s <= w + 1; s += 5) {
      this.line([[x + s, y + h], [x + s - 4, y + h + side * 5]]);
      pen.stroke();
    }
    this.pin(x, y, r);
  }

  pin(x, y, r) {
    const {pen, ink} = this;
    pen.beginPath();
    pen.arc(x, y, r, 0, 7);
    pen.fillStyle = ink.card;
    pen.fill();
    pen.lineWidth = 1.6;
    pen.strokeStyle = ink.rod;
    pen.stroke();
  }

  // A ring where something has just struck.
  marks(t, dots, glow) {
    const {pen, run} = this;
    for (const event of run.recent(t, glow)) {
      const age = (t - event.t) / glow;
      pen.globalAlpha = 1 - age;
      pen.strokeStyle = this.ink.force;
      pen.lineWidth = 3 * (1 - age) + 0.5;
      for (const k of event.kind === "impact" ? event.points : []) {
        pen.beginPath();
        pen.arc(dots[k][0], dots[k][1], this.radius * (1.2 + 2.4 * age), 0, 7);
        pen.stroke();
      }
    }
    pen.globalAlpha = 1;
  }

  forces(moment, dots) {
    const {pen, run, view, ink} = this;
    if (!run.usual) return;
    const full = 0.18 * this.size, reach = 1.5 * full;
    pen.strokeStyle = pen.fillStyle = ink.force;
    for (const push of run.pushes) {
      const force = run.force(push, moment);
      const [x, y] = dots[push.point];
      if (!force || !Number.isFinite(x + y)) continue;
      const [dx, dy] = view.along(force).map((c) => c / view.scale * full / run.usual);
      const length = Math.hypot(dx, dy);
      if (length < 1.5) continue;
      const cut = Math.min(1, reach / length);
      this.arrow(x, y, x + cut * dx, y + cut * dy, cut < 1);
    }
    if (this.one) return;
    const round = stepOf(run.usual, 2);
    const long = round / run.usual * full, y = view.height - 34;
    this.arrow(46, y, 46 + long, y, false);
    pen.fillStyle = ink.dim;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    const unit = run.units.force || "";
    pen.strokeStyle = ink.card;
    pen.lineWidth = 4;
    const text = `constraint force ${written(round, round)} ${unit}`.trim();
    pen.strokeText(text, 54 + long, y);
    pen.fillText(text, 54 + long, y);
  }

  // One that is longer than shown has a gap in its shaft.
  arrow(x, y, tox, toy, cut, colour = this.ink.force) {
    const {pen} = this;
    const length = Math.hypot(tox - x, toy - y), head = Math.min(11, 0.6 * length);
    const [ux, uy] = [(tox - x) / length, (toy - y) / length];
    const [bx, by] = [tox - head * ux, toy - head * uy];
    pen.fillStyle = pen.strokeStyle = colour;
    pen.lineWidth = 2.6;
    pen.lineCap = "butt";
    const shaft = (a, b) => {
      this.line([[x + a * ux, y + a * uy], [x + b * ux, y + b * uy]]);
      pen.stroke();
    };
    const whole = Math.max(0, length - head);
    if (cut) { shaft(0, 0.6 * whole); shaft(0.6 * whole + 5, whole); } else shaft(0, whole);
    this.line([[tox, toy], [bx - 0.42 * head * uy, by + 0.42 * head * ux],
      [bx + 0.42 * head * uy, by - 0.42 * head * ux]], true);
    pen.fill();
    pen.lineCap = "round";
  }

  names(dots) {
    const {pen, run, ink} = this;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    const label = (plain, x, y) => {
      const name = withSubscripts(plain);
      if (!Number.isFinite(x + y)) return;
      pen.lineWidth = 3;
      pen.strokeStyle = ink.card;
      pen.strokeText(name, x, y);
      pen.fillStyle = ink.ink;
      pen.fillText(name, x, y);
    };
    run.points.forEach(({name}, k) => label(name, dots[k][0] + this.radius + 5, dots[k][1] - this.radius));
    // A shape without a point has its name in its middle.
    for (const {shape, dots: corners} of this.placed) {
      const there = corners.filter(([x, y]) => Number.isFinite(x + y));
      const middle = (c) => there.reduce((sum, dot) => sum + dot[c] / there.length, 0);
      if (shape.point === null && there.length) label(shape.name, middle(0), middle(1));
    }
  }

  axes() {
    const {pen, view, ink} = this, x = view.width - 48, y = view.height - 46;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 1.5;
    for (const [k, name] of ["x", "y", "z"].entries()) {
      const [dx, dy] = [30 * view.right[k], -30 * view.up[k]];
      pen.strokeStyle = ink.ground;
      this.line([[x, y], [x + dx, y + dy]]);
      pen.stroke();
      pen.fillStyle = ink.dim;
      pen.fillText(name, x + 1.3 * dx, y + 1.3 * dy);
    }
  }
}
