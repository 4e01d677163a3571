// A start that moves on its constraints: where a point, or one value, is put.
//
// As lagsim/studies/explore/dragging.py has it, without contacts.

const MOST_DRAGS = 50, MOST_CORRECTIONS = 15, MOST_HALVINGS = 20, LONGER = 4, NOWHERE = 1e-9, SLOW = 1e-12, UNMOVED = 1e-15;
const NEARER = 1e-7, ASIDE = 0.01, HOLDS = 1e-9, ROUNDING = 1e-15;

class ConstrainedStart {
  // known : all values at the start.
  constructor(starts, known) {
    Object.assign(this, {starts, known, model: starts.model, graph: starts.graph});
    this.every = this.model.q.map((_, j) => j);
    const at = Object.fromEntries(this.model.defined.map((x) => [x.name, known[x.name] ?? x.value]));
    this.held = starts.relations(0, {definitions: true, at});
    this.rates = starts.relations(1, {definitions: true, at});
    this.regular = !this.singular(known);
  }

  // Coordinates and velocities with a point of the scene at a target, or near it.
  dragged(place, name, target) {
    const point = this.model.scene.points.find((x) => x.name === name);
    let {known} = this;
    if (point && point.slopes.some((row) => row.length)) {
      const nodes = point.slopes.flat().map(([, node]) => node);
      known = this.towards({
        at: (x) => this.graph.at(point.nodes, x),
        slopes: (x) => {
          const values = this.graph.at(nodes, x);
          let k = 0;
          return point.slopes.map((row) => { const full = this.every.map(() => 0); for (const [j] of row) full[j] = values[k++]; return full; });
        },
      }, {...known, ...place}, target.slice(0, point.nodes.length));
    }
    return this.named(this.withRates(known));
  }

  // Coordinates and velocities with one set to a value, or near it.
  put(name, value) {
    const {q, v} = this.model, j = (q.includes(name) ? q : v).indexOf(name);
    const unit = this.every.map((k) => Number(k === j));
    if (q.includes(name)) {
      const known = this.towards({at: (x) => [x[name]], slopes: () => [unit]}, this.known, [value]);
      return this.named(this.withRates(known));
    }
    const {r, J} = this.starts.look(this.rates, this.known, this.every);
    const near = this.changed(v, this.known, this.step([...J, unit], [...r.map((y) => -y), value - this.known[name]], this.known));
    return this.named(this.withRates(near));
  }

  named(known) {
    return Object.fromEntries([...this.model.q, ...this.model.v].map((x) => [x, known[x]]));
  }

  changed(names, known, change) {
    if (!change.every(Number.isFinite)) return known;
    return {...known, ...Object.fromEntries(names.map((x, j) => [x, known[x] + change[j]]))};
  }

  // The least change in the metric of M that solves J x = b.
  step(J, b, known, L = this.starts.factor(0, known, this.every)) {
    return J.length ? backward(L, leastSquares(J.map((row) => forward(L, row)), b)) : this.every.map(() => 0);
  }

  withRates(known) {
    const {r, J} = this.starts.look(this.rates, known, this.every);
    return this.changed(this.model.v, known, this.step(J, r.map((y) => -y), known));
  }

  // The state with constraints of positions solved by least change.
  on(known) {
    const {q} = this.model, L = this.starts.factor(0, known, this.every);
    for (let step = 0; step < MOST_CORRECTIONS && this.held.wanted.length; step++) {
      const {r, J} = this.starts.look(this.held, known, this.every), change = this.step(J, r.map((y) => -y), known, L);
      known = this.changed(q, known, change);
      if (!q.some((x, j) => Math.abs(change[j]) > UNMOVED * Math.max(Math.abs(known[x]), 1e-3))) break;
    }
    return known;
  }

  holds(known) {
    const {r, J, scale} = this.starts.look(this.held, known, this.every), most = Math.max(...this.model.q.map((x) => Math.abs(known[x])));
    if (this.regular && this.singular(known)) return false;
    return r.every((y, i) => Math.abs(y) <= HOLDS * scale[i] + ROUNDING * most * J[i].reduce((sum, x) => sum + Math.abs(x), 0));
  }

  // Whether the mass matrix alone is singular, as in a gimbal lock.
  singular(known) {
    const M = this.starts.metric(known), scale = M.map((row, j) => Math.sqrt(Math.abs(row[j])));
    if (!scale.every((x) => x > 0)) return true;
    return !(Math.min(...eigen(M.map((row, i) => row.map((x, j) => x / scale[i] / scale[j]))).values) >= this.model.scene.dependent);
  }

  towards(place, known, target) {
    const away = (x) => this.holds(x) ? norm(place.at(x).map((y, k) => target[k] - y)) : Infinity;
    known = this.on(known);
    let far = away(known);
    if (far === Infinity) return this.known;
    const least = NOWHERE * far;
    let share = 1;
    for (let step = 0; step < MOST_DRAGS && far > least; step++) {
      const L = this.starts.factor(0, known, this.every), basis = this.basis(known, L);
      const from = place.at(known), slopes = place.slopes(known), J = slopes.map((row) => forward(L, row));
      for (const row of J) for (const b of basis) { const d = dot(b, row); b.forEach((c, i) => { row[i] -= d * c; }); }
      const change = backward(L, leastSquares(J, from.map((y, k) => target[k] - y), J.map(() => 1)));
      const ahead = slopes.map((row) => dot(row, change));
      // Where the target is out of reach, whole steps are too long; a step begins near
      // the length of the one before.
      let best = known, nearest = far, part = share;
      for (let half = 0; half < MOST_HALVINGS; half++) {
        const other = this.on(this.changed(this.model.q, known, change.map((c) => part * c)));
        // A point that does not move as its derivatives predict is outside their range of validity.
        const there = place.at(other), beyond = norm(there.map((y, k) => y - from[k] - part * ahead[k])) > part * norm(ahead) / 2;
        const now = beyond ? Infinity : away(other);
        if (nearest < Math.min(now, far)) break;
        if (now < nearest) [best, nearest, share] = [other, now, Math.min(1, LONGER * part)];
        part /= 2;
      }
      const slow = !(nearest <= (1 - SLOW) * far), found = slow ? this.beside(place, known, target, far, away) : null;
      if (found) {
        [known, far] = [found, away(found)];
        continue;
      }
      [known, far] = [best, nearest];
      if (slow) break;
    }
    return known;
  }

  // What the constraints of positions span, in coordinates in which M is the identity.
  basis(known, L) {
    return this.held.wanted.length ? rowSpace(this.starts.look(this.held, known, this.every).J.map((row) => forward(L, row))) : [];
  }

  // A state beside a dead point that is nearer to the target, or null.
  beside(place, known, target, far, away) {
    const {q, forces} = this.model, L = this.starts.factor(0, known, this.every), basis = this.basis(known, L);
    const within = eigen(this.every.map((i) => this.every.map((j) => Number(i === j) - basis.reduce((sum, b) => sum + b[i] * b[j], 0))));
    const J = place.slopes(known).map((row) => forward(L, row)), size = norm(J.flat()), force = this.graph.at(forces, known);
    let best = null, nearest = (1 - NEARER) * far;
    within.vectors.forEach((along, k) => {
      if (!(within.values[k] > 0.5) || norm(J.map((row) => dot(row, along))) > this.model.scene.dependent * size) return;
      const way = backward(L, along), most = Math.max(...way.map(Math.abs));
      const length = ASIDE * Math.max(far, ...q.map((x) => Math.abs(known[x]))) / most * (dot(force, way) < 0 ? -1 : 1);
      for (const sign of [length, -length]) {
        const other = this.on(this.changed(q, known, way.map((c) => sign * c))), now = away(other);
        if (now < nearest) [best, nearest] = [other, (1 - NEARER) * now];
      }
    });
    return best;
  }
}
