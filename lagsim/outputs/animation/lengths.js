// The lengths of constraints at a state, and the sizes that their residuals are
// compared with, as lagsim/admissibility has them (`Lengths`, `judge`).

const LINKS = 3, LONG = 1e3, MOTION = 0.1, STATE_ROUNDOFF = 4 * ROUNDOFF, SURFACE_ROUNDOFF = 512 * ROUNDOFF;

// The length over which a gradient changes by its own size.
function lengthOf(size, first, second) {
  if (![size, first, second].every(Number.isFinite)) return Infinity;
  return Math.min(first > 0 ? size / first : Infinity, second > 0 ? Math.sqrt(size / second) : Infinity);
}

class Lengths {
  constructor(starts, known) {
    const {shapes, q, v} = starts.model;
    this.nodes = starts.shapeNodes ||= shapes.flatMap((x) => x.table);
    const M = starts.metric(known), values = starts.graph.at(this.nodes, known);
    const roots = M.map((row, j) => Math.sqrt(Math.abs(row[j])));
    this.weights = roots.map((x) => x || Math.max(...roots) || 1);
    this.u = q.map((x, j) => this.weights[j] * known[x]);
    this.v = v.map((x, j) => this.weights[j] * known[x]);
    this.bodies = this.joined(starts.model.mass, q.length);
    let at = 0;
    this.forms = shapes.map(({columns, ways}) => {
      const table = range(2 * ways.length + 1).map((k) => {
        const way = k ? this.weights[ways[(k - 1) >> 1]] : 1, scale = k ? (k % 2 ? 1 / way : 1 / way ** 2) : 1;
        return columns.map((j) => values[at++] / this.weights[j] * scale);
      });
      const size = table.map(norm);
      const rounding = STATE_ROUNDOFF * ways.reduce((sum, j, k) => sum + size[2 * k + 1] * Math.abs(this.u[j]), 0);
      const own = size[0] > rounding ? size[0] : 0;
      const lengths = ways.map((j, k) => [j, lengthOf(own, size[2 * k + 1], size[2 * k + 2])]);
      return {columns, table, lengths, shortest: Math.min(Infinity, ...lengths.map(([, x]) => x))};
    });
    this.lengths = this.shortest(q.length);
  }

  // For each coordinate the first one that M couples it to.
  joined(mass, n) {
    const first = range(n), root = (j) => first[j] === j ? j : root(first[j]);
    for (const [i, j] of mass) { const [a, b] = [root(i), root(j)]; first[Math.max(a, b)] = Math.min(a, b); }
    return range(n).map(root);
  }

  // The shortest length at each coordinate; affine forms pass those of others on.
  shortest(n) {
    const found = new Array(n).fill(Infinity);
    for (const {lengths, shortest} of this.forms)
      for (const [j, own] of lengths) {
        const length = own > LONG * shortest ? shortest : own;
        if (length > 0) found[j] = Math.min(found[j], length);
      }
    for (let link = 0; link < LINKS; link++) {
      const before = [...found];
      for (const form of this.forms) {
        const scale = form.shortest === Infinity ? this.longest(form, before) : -Infinity;
        form.columns.forEach((j, k) => {
          const slope = Math.abs(form.table[0][k]);
          if (scale > 0 && slope > 0 && found[j] === Infinity) found[j] = scale / slope;
        });
      }
    }
    return found;
  }

  longest({columns, table}, lengths) {
    return Math.max(-Infinity, ...columns.flatMap((j, k) => Number.isFinite(lengths[j]) && table[0][k] !== 0 ? [Math.abs(table[0][k]) * lengths[j]] : []));
  }

  // The size of a relation with this value by its lengths; inf if unknown.
  scale(i, value) {
    const form = this.forms[i], slopes = form.table[0];
    if (!slopes.every(Number.isFinite)) return Infinity;
    if (Number.isFinite(form.shortest)) return norm(slopes) * form.shortest;
    const scale = this.longest(form, this.lengths);
    if (Number.isFinite(scale)) return scale;
    const own = form.columns.map((j, k) => slopes[k] * this.u[j]), sum = own.reduce((a, b) => a + b, 0);
    const constant = Math.abs(value - sum);
    return constant <= SURFACE_ROUNDOFF * Math.max(0, ...own.map(Math.abs)) ? Infinity : Math.max(constant, Math.abs(sum));
  }

  // The size of the motion in a relation; inf if unknown.
  motion(i) {
    const {columns, table, lengths, shortest} = this.forms[i];
    if (shortest === Infinity || !table.flat().every(Number.isFinite)) return Infinity;
    const seen = table.map((row, k) => row.map((x) => k ? x * (k % 2 ? shortest : shortest ** 2) : x));
    const basis = rowSpace(seen), v = columns.map((j) => this.v[j]);
    return norm(table[0]) * norm(basis.map((b) => dot(b, v)));
  }

  // The size of the motion of the bodies of a relation.
  body(i) {
    const {columns, table} = this.forms[i], own = new Set(columns.map((j) => this.bodies[j]));
    return norm(table[0]) * norm(this.v.filter((_, j) => own.has(this.bodies[j])));
  }

  // Bounds of |g| of a satisfied relation and of its rate, and their reasons.
  bounds(i, g, gTerms, rateTerms) {
    const own = this.scale(i, g), motion = this.motion(i);
    let [held, of] = [gTerms, "its largest term"], [moving, why] = [rateTerms, "its largest term"];
    if (own < held) [held, of] = [own, "the lengths that it relates"];
    if (motion < moving) [moving, why] = [motion, "the velocities that it relates"];
    else if (motion < Infinity && MOTION * motion > moving) [moving, why] = [MOTION * motion, "a tenth of the velocities that it relates"];
    const bound = (scale, floor, what) => SATISFIED * scale >= floor ? [SATISFIED * scale, `1e-06 of ${what}`] : [floor, "the rounding of numbers in full precision"];
    return {
      held: bound(held, Math.max(own < Infinity ? RESIDUAL_ROUNDOFF * own : 0, 4 * ROUNDOFF * gTerms), of),
      moving: bound(moving, Math.max(CONVERGED * this.body(i), 4 * ROUNDOFF * rateTerms), why),
    };
  }
}
