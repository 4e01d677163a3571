// The film of a motion from its columns: what `outputs/animation` records for a page.

// A percentile, with linear interpolation, of ascending numbers.
function percentile(sorted, part) {
  const at = part / 100 * (sorted.length - 1), k = Math.floor(at);
  return k + 1 < sorted.length ? sorted[k] + (at - k) * (sorted[k + 1] - sorted[k]) : sorted[k];
}

class Filming {
  constructor(model, graph) {
    this.model = model;
    this.scene = model.scene;
    this.graph = graph;
  }

  // The film of `count` rows of columns, with the values of the parameters.
  record(known, columns, count) {
    const {scene} = this, {dimension: d} = scene, t = columns.t, values = {...known, ...columns};
    const tracks = this.tracks(values, count), shapes = this.shapes(values, count);
    const places = tracks.map((x) => x.place), size = this.extent(places, count);
    const every = this.reached(places, shapes, count), box = this.box(every);
    const broken = [];
    for (let i = 0; i < count; i++) {
      const step = i + 1 < count ? t[i + 1] - t[i] : 0;
      let swift = false;
      for (const {rate} of tracks)
        for (let k = i * d; k < i * d + d; k++) swift = swift || !(Math.abs(rate[k]) * step <= scene.swift * size && Number.isFinite(rate[k]));
      if (swift) broken.push(i);
    }
    const points = tracks.map(({name, place, rate}) => this.still(place, count, size) ? {name, fixed: Array.from(place.subarray(0, d))} : {name, place: new Float32Array(place), rate: new Float32Array(rate)});
    const energies = Object.fromEntries(scene.energies.map((name) => [name, new Float32Array(columns[name])]));
    return {
      name: this.model.name, description: this.model.description, t: new Float64Array(t), broken,
      dimension: d, box, floor: this.floor(tracks, every, shapes, box, count), points,
      links: scene.links.map((x) => this.link(x, tracks, values, count)),
      shapes: shapes.map((x) => x.shown), pushes: this.pushes(values, count), energies,
      events: [], horizon: null, units: scene.units, notes: [],
    };
  }

  // Position and velocity of each point, row by row.
  tracks(values, count) {
    const {points, dimension: d} = this.scene;
    const nodes = this.pointNodes ||= points.flatMap((x) => [...x.nodes, ...x.rates]);
    const found = this.graph.rows(nodes, values, count);
    let k = 0;
    const laid = (parts) => {
      const all = new Float64Array(count * d);
      for (let c = 0; c < parts; c++, k++) for (let i = 0; i < count; i++) all[i * d + c] = found[k][i];
      return all;
    };
    return points.map((x) => ({name: x.name, place: laid(x.nodes.length), rate: laid(x.rates.length)}));
  }

  still(place, count, size) {
    const {dimension: d, zero} = this.scene;
    for (let c = 0; c < d; c++) {
      let low = Infinity, high = -Infinity;
      for (let i = 0; i < count; i++) {
        const x = place[i * d + c];
        if (!Number.isFinite(x)) return false;
        low = Math.min(low, x); high = Math.max(high, x);
      }
      if (!(high - low <= zero * size)) return false;
    }
    return true;
  }

  extent(places, count) {
    const {dimension: d} = this.scene, low = new Array(d).fill(Infinity), high = new Array(d).fill(-Infinity);
    for (const place of places) for (let i = 0; i < count; i++) {
      let finite = true;
      for (let c = 0; c < d; c++) finite = finite && Number.isFinite(place[i * d + c]);
      for (let c = 0; finite && c < d; c++) {
        low[c] = Math.min(low[c], place[i * d + c]);
        high[c] = Math.max(high[c], place[i * d + c]);
      }
    }
    return Math.max(0, ...low.map((x, c) => high[c] - x).filter((x) => x >= 0));
  }

  // --- Shapes

  shapes(values, count) {
    return this.scene.shapes.map((shape) => this.shape(shape, values, count));
  }

  shape(shape, values, count) {
    const {dimension: d} = this.scene, rows = shape.moves ? count : 1, first = {};
    for (const [name, x] of Object.entries(values)) first[name] = typeof x === "number" ? x : shape.moves ? x : x[0];
    const sizes = this.graph.at(shape.sizes, Object.fromEntries(Object.entries(first).map(([k, x]) => [k, typeof x === "number" ? x : x[0]])));
    const laid = (nodes, width, put) => {
      const found = this.graph.rows(nodes, first, rows), all = new Float64Array(rows * width);
      return put(found, all);
    };
    const at = laid(shape.at, d, (found, all) => { found.forEach((x, c) => { for (let i = 0; i < rows; i++) all[i * d + c] = x[i]; }); return all; });
    const own = Math.round(Math.sqrt(shape.axes.length));
    // Axes by rows of the matrix; a body without axes stands upright.
    const axes = laid(shape.axes, d * d, (found, all) => {
      for (let i = 0; i < rows; i++) for (let a = 0; a < d; a++) all[i * d * d + a * d + a] = 1;
      for (let a = 0; a < own; a++) for (let b = 0; b < own; b++) for (let i = 0; i < rows; i++) all[i * d * d + a * d + b] = found[a * own + b][i];
      return all;
    });
    const corners = this.corners(shape, sizes, first, rows);
    const many = corners.values.length / corners.rows / d;
    // The body's axes are the columns of the matrix; the page wants all but the last.
    const shown = new Float64Array(rows * d * (d - 1));
    for (let i = 0; i < rows; i++) for (let b = 0; b < d - 1; b++) for (let a = 0; a < d; a++) shown[(i * (d - 1) + b) * d + a] = axes[i * d * d + a * d + b];
    const coded = (all, n) => {
      const width = all.length / n;
      for (let i = width; i < all.length; i++) if (all[i] !== all[i % width]) return {place: new Float32Array(all)};
      return {fixed: Float32Array.from(all.subarray(0, width))};
    };
    const {name, kind, moves, point, carried, faces, edges, seams} = shape;
    const radius = kind === "sphere" ? sizes[0] : 0;
    return {
      shape, at, axes, corners, rows, many, radius, height: shape.level ? corners.values[2] : null,
      shown: {name, kind, moves, point, carried, radius, faces, edges, seams, at: coded(at, rows), axes: coded(shown, rows), corners: coded(corners.values, corners.rows)},
    };
  }

  corners(shape, sizes, values, count) {
    const {dimension: d} = this.scene;
    if (shape.mesh) {
      // Corners of a body are linear in its sizes.
      const found = new Float64Array(shape.mesh.many * d);
      shape.mesh.parts.forEach((part, i) => part.forEach((x, k) => { found[k] += sizes[i] * x; }));
      return {values: found, rows: 1};
    }
    const rows = shape.changes ? count : 1;
    if (shape.kind === "curve") {
      const n = rows === 1 ? shape.along : shape.changing, all = {};
      const s = range(n).map((k) => sizes[0] + (sizes[1] - sizes[0]) * k / (n - 1));
      s[n - 1] = sizes[1];
      for (const [name, x] of Object.entries(values)) {
        if (typeof x === "number") { all[name] = x; continue; }
        if (!shape.needs.includes(name)) continue;
        const many = new Float64Array(rows * n);
        for (let i = 0; i < rows; i++) many.fill(x[i], i * n, i * n + n);
        all[name] = many;
      }
      all[shape.parameter] = Float64Array.from({length: rows * n}, (_, k) => s[k % n]);
      const found = this.graph.rows(shape.corners[0], all, rows * n), out = new Float64Array(rows * n * d);
      found.forEach((x, c) => { for (let k = 0; k < rows * n; k++) out[k * d + c] = x[k]; });
      return {values: out, rows};
    }
    const arrow = shape.kind === "arrow", n = arrow ? 2 : shape.corners.length, out = new Float64Array(rows * n * d);
    const scale = arrow ? (sizes.length ? sizes[0] : 1) : 1;
    shape.corners.forEach((nodes, k) => {
      const found = this.graph.rows(nodes, values, rows);
      found.forEach((x, c) => { for (let i = 0; i < rows; i++) out[(i * n + k + Number(arrow)) * d + c] = scale * x[i]; });
    });
    return {values: out, rows};
  }

  // Writes the corners of a body in one row, in the axes of the scene, from `first` on.
  placed({at, axes, corners: {rows, values}, many}, i, found, first) {
    const {dimension: d} = this.scene, own = rows === 1 ? 0 : i * many * d;
    for (let a = 0; a < d; a++) {
      const x = at[i * d + a], from = (i * d + a) * d, [u, v, w] = [axes[from], axes[from + 1], d > 2 ? axes[from + 2] : 0];
      for (let k = 0, n = own, to = first + a; k < many; k++, n += d, to += d)
        found[to] = d > 2 ? x + u * values[n] + v * values[n + 1] + w * values[n + 2] : x + u * values[n] + v * values[n + 1];
    }
  }

  // Finite places of points and bodies, one after another.
  reached(places, shapes, count) {
    const {dimension: d} = this.scene, heights = shapes.filter((x) => x.height !== null).map((x) => x.height);
    const bodies = shapes.filter((x) => x.height === null).map((body) => ({
      body, rows: [...new Set(range(500).map((k) => Math.trunc((body.rows - 1) * k / 499)))],
    }));
    const total = places.length * count + bodies.reduce((sum, {body, rows}) => sum + rows.length * (body.radius ? 2 : body.many), 0);
    const found = new Float64Array((total + heights.length) * d);
    let end = 0;
    for (const place of places) { found.set(place, end); end += place.length; }
    for (const {body, rows} of bodies)
      for (const i of rows) {
        if (body.radius) {
          for (const way of [-body.radius, body.radius]) for (let c = 0; c < d; c++) found[end++] = body.at[i * d + c] + way;
        } else {
          this.placed(body, i, found, end);
          end += body.many * d;
        }
      }
    let kept = 0;
    for (let i = 0; i < end; i += d) {
      let finite = true;
      for (let c = 0; c < d; c++) finite = finite && Number.isFinite(found[i + c]);
      if (!finite) continue;
      if (kept < i) for (let c = 0; c < d; c++) found[kept + c] = found[i + c];
      kept += d;
    }
    // A plane is at the middle of all else.
    const middle = new Array(d).fill(0);
    for (let i = 0; i < kept; i++) middle[i % d] += found[i];
    const many = Math.max(1, kept / d);
    for (const z of heights) { found.set([middle[0] / many, middle[1] / many, z], kept); kept += d; }
    return found.subarray(0, kept);
  }

  box(every) {
    const {dimension: d, most, outlying} = this.scene, many = every.length / d;
    if (!many) return range(d).map(() => [0, 0]);
    const columns = range(d).map((c) => {
      const own = new Float64Array(many);
      for (let k = 0, n = c; k < many; k++, n += d) own[k] = every[n];
      return own;
    });
    const box = columns.map((x) => {
      let low = x[0], high = x[0];
      for (let k = 1; k < many; k++) { if (x[k] < low) low = x[k]; else if (x[k] > high) high = x[k]; }
      return [low, high];
    });
    const span = (pairs) => Math.max(...pairs.map(([a, b]) => b - a)), whole = span(box);
    // Percentiles need not be found where a count in parts of the box shows them far apart.
    if (whole <= outlying * Math.max(...columns.map((x, c) => this.least(x, box[c])))) return box;
    for (const x of columns) x.sort();
    const usual = columns.map((x) => [percentile(x, 100 - most), percentile(x, most)]);
    return whole > outlying * span(usual) && span(usual) > 0 ? usual : box;
  }

  // A bound from below of the distance of the percentiles between which most numbers lie.
  least(numbers, [low, high]) {
    const parts = 256, counts = new Float64Array(parts + 1), width = (high - low) / parts;
    if (!(width > 0)) return 0;
    for (let k = 0; k < numbers.length; k++) counts[Math.floor((numbers[k] - low) / width)]++;
    const beyond = (1 - this.scene.most / 100) * numbers.length + 1;
    let first = 0, last = parts, sum = 0;
    while (first <= parts && (sum += counts[first]) <= beyond) first++;
    for (sum = 0; last >= 0 && (sum += counts[last]) <= beyond;) last--;
    return Math.max(0, last - first - 1) * width;
  }

  floor(tracks, every, shapes, box, count) {
    const level = shapes.find((x) => x.height !== null);
    if (level) return level.height;
    const {dimension: d, near} = this.scene, under = box[d - 1][0];
    let lowest = under;
    for (const {place} of tracks) for (let i = 0; i < count; i++) { const x = place[i * d + d - 1]; if (Number.isFinite(x)) lowest = Math.min(lowest, x); }
    for (let k = d - 1; k < every.length; k += d) lowest = Math.min(lowest, every[k]);
    const size = Math.max(...box.map(([a, b]) => b - a));
    return lowest >= under - near * size ? lowest : null;
  }

  link({ends: [a, b], look, length, struck}, tracks, values, count) {
    const {dimension: d, rigid, taut, satisfied} = this.scene, one = tracks[a].place, other = tracks[b].place;
    let lengths = new Float64Array(count);
    for (let i = 0; i < count; i++) {
      let sum = 0;
      for (let k = i * d; k < i * d + d; k++) sum += (one[k] - other[k]) ** 2;
      lengths[i] = Math.sqrt(sum);
    }
    lengths = lengths.filter(Number.isFinite).sort();
    if (!lengths.length) lengths = new Float64Array(1);
    const most = lengths[lengths.length - 1];
    const longest = length === null ? most : this.graph.at([length], Object.fromEntries(Object.entries(values).filter(([, x]) => typeof x === "number")))[0];
    let kind = look || "spring";
    if (!look && lengths[0] >= (1 - rigid) * longest) kind = "rod";
    else if (!look && struck && lengths.filter((x) => x >= (1 - satisfied) * longest).length > taut * lengths.length) kind = "string";
    return {ends: [a, b], kind, longest, usual: percentile(lengths, 50)};
  }

  // --- Forces of constraints: A^T = J^T f for one f, the force of a unit multiplier

  pushes(values, count) {
    const {dimension: d} = this.scene, found = new Map();
    for (const push of this.scene.pushes) {
      const multiplier = values[push.multiplier];
      if (!multiplier || !multiplier.some((x) => x !== 0)) continue;
      const forces = this.shares(push, values, count);
      push.points.forEach((point, k) => {
        const key = `${push.name} ${point}`, all = found.get(key) || {name: push.name, point, force: new Float64Array(count * d)};
        push.parts[k].forEach((row, c) => {
          if (row === null) return;
          for (let i = 0; i < count; i++) all.force[i * d + c] += multiplier[i] === 0 ? 0 : multiplier[i] * forces[row][i];
        });
        found.set(key, all);
      });
    }
    for (const {point, parts} of this.scene.reactions) {
      const force = new Float64Array(count * d);
      parts.forEach((name, c) => { if (name) for (let i = 0; i < count; i++) force[i * d + c] = values[name][i]; });
      found.set(`reaction ${point}`, {name: "reaction", point, force});
    }
    return [...found.values()].map((x) => ({...x, force: new Float32Array(x.force), usual: this.usual(x.force)}));
  }

  // The components of the forces of a multiplier of 1, in each row; nan where not unique.
  shares({jacobian, row}, values, count) {
    const parts = jacobian.length, n = row.length, found = this.graph.rows([...jacobian.flat(), ...row], values, count);
    const forces = range(parts).map(() => new Float64Array(count).fill(NaN)), {dependent, half} = this.scene;
    const J = range(parts).map(() => new Float64Array(n)), A = new Float64Array(n), f = new Float64Array(parts);
    // J of rows with equal J is decomposed once: it is constant where points are coordinates.
    let known = null;
    for (let i = 0; i < count; i++) {
      let finite = true;
      for (let k = 0; k < parts; k++) for (let j = 0; j < n; j++) {
        const x = found[k * n + j][i];
        if (J[k][j] !== x) { J[k][j] = x; known = null; }
        finite = finite && Number.isFinite(x);
      }
      for (let j = 0; j < n; j++) { A[j] = found[parts * n + j][i]; finite = finite && Number.isFinite(A[j]); }
      if (!finite) { known = null; continue; }
      known ||= eigen(J.map((a) => J.map((b) => dot(a, b))));
      const {values: own, vectors} = known, most = Math.max(...own);
      if (!own.every((x) => x > dependent ** 2 * most)) continue;
      const right = J.map((a) => dot(a, A));
      f.fill(0);
      for (let k = 0; k < parts; k++) {
        const share = dot(vectors[k], right) / own[k];
        for (let m = 0; m < parts; m++) f[m] += share * vectors[k][m];
      }
      let longest = 0, holds = true;
      for (let k = 0; k < parts; k++) longest = Math.max(longest, Math.abs(f[k]));
      for (let j = 0; j < n; j++) {
        let sum = 0, size = 0;
        for (let k = 0; k < parts; k++) { sum += J[k][j] * f[k]; size += Math.abs(J[k][j]); }
        holds = holds && Math.abs(sum - A[j]) <= half * (size * longest + Math.abs(A[j]));
      }
      if (holds) for (let k = 0; k < parts; k++) forces[k][i] = f[k];
    }
    return forces;
  }

  usual(force) {
    const {dimension: d, most} = this.scene;
    const every = new Float64Array(force.length / d);
    for (let i = 0; i < every.length; i++) {
      let sum = 0;
      for (let k = i * d; k < i * d + d; k++) sum += force[k] ** 2;
      every[i] = Math.sqrt(sum);
    }
    const sizes = every.filter((x) => Number.isFinite(x) && x > 0).sort();
    return sizes.length ? percentile(sizes, most) : 0;
  }
}
