// The start of a motion: values, guesses by Newton's method, verdicts.
//
// As lagsim/admissibility decides, at one state.

const SATISFIED = 1e-6, CONVERGED = 1e-12, ROUNDOFF = 2 ** -53, RESIDUAL_ROUNDOFF = 64 * ROUNDOFF;
const DEPENDENT = 1e-13;

// --- Small dense matrices, as arrays of rows

const dot = (a, b) => { let sum = 0; for (let k = 0; k < a.length; k++) sum += a[k] * b[k]; return sum; };
const range = (n) => Array.from({length: n}, (_, k) => k);
const norm = (a) => Math.hypot(...a);
const identity = (n) => Array.from({length: n}, (_, i) => Array.from({length: n}, (_, j) => Number(i === j)));

// The lower triangle L of M = L L^T; null where M is not positive definite.
function cholesky(M) {
  const n = M.length, L = M.map(() => new Array(n).fill(0));
  for (let i = 0; i < n; i++)
    for (let j = 0; j <= i; j++) {
      let sum = M[i][j];
      for (let k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
      if (i > j) L[i][j] = sum / L[j][j];
      else if (sum > 16 * n * ROUNDOFF * Math.abs(M[i][i])) L[i][i] = Math.sqrt(sum);
      else return null;
    }
  return L;
}

// L x = b, and L^T x = b.
function forward(L, b) {
  const x = [...b];
  for (let i = 0; i < x.length; i++) {
    for (let k = 0; k < i; k++) x[i] -= L[i][k] * x[k];
    x[i] /= L[i][i];
  }
  return x;
}
function backward(L, b) {
  const x = [...b];
  for (let i = x.length - 1; i >= 0; i--) {
    for (let k = i + 1; k < x.length; k++) x[i] -= L[k][i] * x[k];
    x[i] /= L[i][i];
  }
  return x;
}

// Eigenvalues and orthonormal eigenvectors (as rows) of a symmetric matrix, by Jacobi.
function eigen(S) {
  const n = S.length, a = S.map((row) => [...row]), v = identity(n);
  for (let sweep = 0; sweep < 60; sweep++) {
    let off = 0, all = 0;
    for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) { all += a[i][j] ** 2; if (i !== j) off += a[i][j] ** 2; }
    if (!(off > 1e-32 * all)) break;
    for (let p = 0; p < n; p++)
      for (let q = p + 1; q < n; q++) {
        if (a[p][q] === 0) continue;
        const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
        const c = 1 / Math.sqrt(t * t + 1), s = t * c;
        for (let k = 0; k < n; k++) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
        for (let k = 0; k < n; k++) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
        for (let k = 0; k < n; k++) [v[p][k], v[q][k]] = [c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]];
      }
  }
  return {values: a.map((row, k) => row[k]), vectors: v};
}

// An orthonormal basis of the space that the rows of A span, each row at its own scale.
function rowSpace(A) {
  const rows = A.map((row) => { const size = norm(row); return size > 0 ? row.map((x) => x / size) : row; });
  const {values, vectors} = eigen(rows.map((a) => rows.map((b) => dot(a, b))));
  const most = Math.max(0, ...values), found = [];
  values.forEach((value, k) => {
    if (!(value > DEPENDENT * most)) return;
    const along = new Array(A[0].length).fill(0);
    vectors[k].forEach((c, i) => rows[i].forEach((x, j) => { along[j] += c * x; }));
    // Once more, against rounding where rows are nearly dependent.
    for (const q of found) { const d = dot(q, along); q.forEach((x, j) => { along[j] -= d * x; }); }
    const size = norm(along);
    found.push(along.map((x) => x / size));
  });
  return found;
}

// The shortest x that minimises |A x - b|, the rows of A at these scales: by default
// their own, for equations that can be satisfied.
function leastSquares(A, b, sizes = A.map((row) => norm(row) || 1)) {
  if (!A.length) return [];
  const rows = A.map((row, i) => row.map((x) => x / sizes[i]));
  const {values, vectors} = eigen(rows.map((a) => rows.map((c) => dot(a, c))));
  const most = Math.max(0, ...values), x = new Array(A[0].length).fill(0);
  values.forEach((value, k) => {
    if (!(value > DEPENDENT * most)) return;
    const share = dot(vectors[k], b.map((y, i) => y / sizes[i])) / value;
    vectors[k].forEach((c, i) => rows[i].forEach((a, j) => { x[j] += share * c * a; }));
  });
  return x;
}

// --- A model at some values

class Start {
  constructor(model) {
    this.model = model;
    this.graph = new Graph(model.nodes);
    this.parsed = new Map();
  }

  // Sizes of shapes are not negative.
  refuseSizes(values) {
    for (const {name, kind, sizes, sized} of this.model.scene.shapes) {
      if (!sized) continue;
      const wrong = this.graph.at(sizes, values).find((x) => !(x >= 0 && x < Infinity));
      if (wrong !== undefined) throw new Error(`a size of the ${kind} \`${name}\` is ${wrong}; it must not be negative [${this.model.numbers["out-of-range"]}]`);
    }
  }

  // The values of all parameters, and start values before guesses are solved for.
  stated(texts) {
    const {parameters, initial, numbers, started, structural} = this.model, values = {};
    const known = new Set([...parameters.map((x) => x.name), ...started]);
    for (const [name, text] of Object.entries(texts)) {
      if (typeof text !== "string" || text.length > 1000) throw new Error(`the value of \`${name}\` is no expression`);
      if (!text.trim()) throw new Error(`the value of \`${name}\` is no expression: empty [${numbers.usage}]`);
      if (!known.has(name)) {
        const fault = new Fault(`there is no parameter or start value \`${name}\``, {code: "unknown-name", length: name.length, source: "name", hint: `one of ${[...known].join(", ")}`});
        throw new Error(fault.shown(name, text, numbers));
      }
      if (structural.includes(name)) throw new Error(`\`${name}\` says how many members there are: another value needs \`lagsim explore\` without -o [${numbers["not-in-a-file"]}]`);
    }
    const below = new Set(parameters.map((x) => x.name));
    for (const x of parameters) {
      values[x.name] = this.read(x, texts, values, `the parameter \`${x.name}\``, below);
      below.delete(x.name);
    }
    this.refuseSizes(values);
    const at = {};
    // A start value that the file does not state comes after those that it states.
    const order = [...initial, ...started.filter((name) => !initial.some((x) => x.name === name)).map((name) => ({name, steps: [0], guess: false}))];
    for (const x of order) {
      at[x.name] = values[x.name] = this.read(x, texts, values, `the start value of \`${x.name}\``, null);
    }
    return {values, at, changed: Object.keys(texts).length > 0};
  }

  read({name, steps}, texts, known, what, below) {
    const text = Object.hasOwn(texts, name) ? texts[name] : null, {numbers} = this.model;
    let own = steps;
    try {
      if (text !== null) own = this.steps(text, known, what, below, name);
      const value = valueOf(own, known);
      if (Number.isFinite(value)) return value;
      const shown = Number.isNaN(value) ? "nan" : value > 0 ? "inf" : "-inf";
      const about = `${what} is ${shown}, which is not a finite number`;
      if (text === null) throw new Error(`${about} [${numbers["not-finite-value"]}]`);
      throw new Fault(about, {code: "not-finite-value", length: text.length,
        hint: "look for a division by 0, or for a root or a logarithm of a negative number"});
    } catch (error) {
      throw error instanceof Fault ? new Error(error.shown(name, text, numbers)) : error;
    }
  }

  // The postfix of a text whose names are all known.
  steps(text, known, what, below, name) {
    const {output, named} = new Parser(text);
    for (const {text: used, at} of named) {
      if (used === "pi" || (Object.hasOwn(known, used) && !(below && below.has(used)))) continue;
      const more = {at, length: used.length};
      if (below && below.has(used))
        throw new Fault(used === name ? `\`${name}\` uses itself` : `\`${name}\` uses \`${used}\`, which is below it`, {...more, code: "later-parameter", hint: "a parameter may use the parameters above it"});
      if (this.model.started.includes(used))
        throw new Fault(below ? `\`${used}\` has a start value; ${what} must be a number` : `the start value of \`${used}\` is not given above this line`, {...more, code: below ? "not-constant" : "later-initial"});
      throw new Fault(`unknown name \`${used}\``, {...more, code: "unknown-name"});
    }
    return output;
  }

  // --- The state

  // Relations between positions (0), velocities (1) or first-order states (2).
  relations(block, {definitions, at}) {
    const {rows, defined, states, q, v, s} = this.model, wanted = [];
    if (block === 2) for (const x of states) wanted.push({name: x.name, node: x.rate, scale: x.rate, A: x.A, target: 0});
    else {
      for (const row of rows) {
        if (block === 0 && row.holonomic) wanted.push({name: row.name, node: row.residual, scale: row.residualScale, A: row.A, target: 0});
        if (block === 1) wanted.push({name: row.name, node: row.rate, scale: row.rateScale, A: row.A, target: 0});
      }
      for (const x of definitions ? defined : [])
        if (x.block === block) wanted.push({name: x.name, node: x.node, scale: x.node, A: x.A, target: at[x.name]});
    }
    const nodes = [...wanted.map((x) => x.node), ...wanted.map((x) => x.scale), ...wanted.flatMap((x) => x.A.map(([, node]) => node))];
    return {names: [q, v, s][block], wanted, nodes};
  }

  // Residuals, their derivatives by the values with indices `free`, and their scales.
  look({wanted, nodes}, known, free) {
    const place = new Map(free.map((j, k) => [j, k]));
    const found = this.graph.at(nodes, known), m = wanted.length;
    let k = 2 * m;
    const J = wanted.map((x) => {
      const row = new Array(free.length).fill(0);
      for (const [j] of x.A) { if (place.has(j)) row[place.get(j)] = found[k]; k++; }
      return row;
    });
    const r = wanted.map((x, i) => found[i] - x.target);
    const scale = wanted.map((x, i) => Math.max(Math.abs(found[m + i]), Math.abs(x.target)));
    return {r, J, scale};
  }

  // M (n, n), or its rows and columns `among`; the identity where it is not positive.
  metric(known, among = null) {
    const {mass, q} = this.model, all = among || q.map((_, j) => j), place = new Map(all.map((j, k) => [j, k]));
    const values = this.graph.at(this.massNodes ||= mass.map(([, , node]) => node), known);
    const M = all.map(() => new Array(all.length).fill(0));
    mass.forEach(([i, j], k) => { if (place.has(i) && place.has(j)) M[place.get(i)][place.get(j)] = values[k]; });
    return M;
  }

  // The factor of the metric in which changes are least.
  factor(block, known, free) {
    const L = block < 2 ? cholesky(this.metric(known, free)) : null;
    return L || identity(free.length);
  }

  // The nearest values that satisfy relations; null where Newton's method finds none.
  nearest(relations, known, free, L) {
    const {names, wanted} = relations;
    if (!free.length || !wanted.length) return known;
    const names_ = free.map((j) => names[j]), x0 = names_.map((name) => known[name]);
    const put = (x) => ({...known, ...Object.fromEntries(names_.map((name, k) => [name, x[k]]))});
    const scaled = (J) => J.map((row) => forward(L, row));
    const solve = (x) => {
      let {r, J, scale} = this.look(relations, put(x), free), polished = 0;
      for (let step = 0; step < 60; step++) {
        if (![...r, ...J.flat()].every(Number.isFinite)) return null;
        const holds = r.every((y, i) => Math.abs(y) <= CONVERGED * scale[i]);
        if (r.every((y) => y === 0) || (holds && polished++ >= 3)) return x;
        const change = backward(L, leastSquares(scaled(J), r.map((y) => -y)));
        const size = (y, over) => Math.max(...y.map((c, i) => Math.abs(c) / (over[i] || 1)));
        const sizes = J.map((row) => norm(forward(L, row))), far = size(r, sizes);
        let damping = 1, next = null;
        for (; damping > 1e-6; damping /= 2) {
          const other = x.map((c, k) => c + damping * change[k]), seen = this.look(relations, put(other), free);
          if (size(seen.r, sizes) < far) { next = {other, seen}; break; }
          if (holds) break;
        }
        if (!next) return holds ? x : null;
        x = next.other;
        ({r, J, scale} = next.seen);
      }
      return null;
    };
    let x = solve(x0);
    if (!x) return null;
    // Along the relations back towards the values before.
    const far = (y) => norm(y.map((c, k) => { let sum = 0; for (let i = k; i < y.length; i++) sum += L[i][k] * (y[i] - x0[i]); return sum; }));
    for (let step = 0; step < 60; step++) {
      const {J} = this.look(relations, put(x), free), basis = rowSpace(scaled(J));
      if (basis.length >= free.length) break;
      const z = x.map((_, k) => { let sum = 0; for (let i = k; i < x.length; i++) sum += L[i][k] * (x[i] - x0[i]); return sum; });
      const along = [...z];
      for (const q of basis) { const d = dot(q, along); q.forEach((c, k) => { along[k] -= d * c; }); }
      if (!(norm(along) > 1e-12 * norm(z))) break;
      const back = backward(L, along);
      let best = null;
      for (let part = 1; part > 1e-3 && !best; part /= 2) {
        const other = solve(x.map((c, k) => c - part * back[k]));
        if (other && far(other) < far(x)) best = other;
      }
      if (!best) break;
      x = best;
    }
    return put(x);
  }

  // The start at some values: guesses solved, constraints satisfied to rounding.
  begun(texts, t) {
    const {q, v, s, initial} = this.model, {values, at} = this.stated(texts);
    let known = {...values, t};
    const guessed = new Set(initial.filter((x) => x.guess).map((x) => x.name));
    const blocks = [q, v, s].map((names) => names.flatMap((name, j) => guessed.has(name) ? [j] : []));
    const again = blocks[1].length && blocks[2].length ? Array.from({length: 16}, (_, k) => 1 + k % 2) : [];
    let unsolved = false;
    for (const block of [0, 1, 2, ...again]) {
      if (!blocks[block].length || unsolved) continue;
      const relations = this.relations(block, {definitions: true, at});
      const found = this.nearest(relations, known, blocks[block], this.factor(block, known, blocks[block]));
      if (found) known = found; else unsolved = true;
    }
    this.refuseInfinite(known);
    this.refuseUnmet(known, at, unsolved);
    this.refuseMass(known);
    // To rounding, by least change.
    for (const block of [0, 1]) {
      const relations = this.relations(block, {definitions: false, at}), every = q.map((_, j) => j);
      if (!relations.wanted.length) continue;
      const {r, scale} = this.look(relations, known, every);
      if (r.every((y, i) => Math.abs(y) <= 4 * ROUNDOFF * scale[i])) continue;
      known = this.nearest(relations, known, every, this.factor(block, known, every)) || known;
    }
    this.refuseRank(known);
    return known;
  }

  refuseInfinite(known) {
    const {finite, numbers} = this.model;
    const values = this.graph.at(this.finiteNodes ||= finite.map((x) => x.node), known);
    const k = values.findIndex((x) => !Number.isFinite(x));
    if (k >= 0) throw new Error(`${finite[k].what} is ${values[k] > 0 ? "inf" : values[k] < 0 ? "-inf" : "nan"} at the start [${numbers["not-finite-value"]}]`);
  }

  refuseMass(known) {
    const {augmented, q, numbers} = this.model;
    if (augmented) return;
    const M = this.metric(known);
    const none = M.findIndex((row) => row.every((x) => x === 0));
    if (none >= 0) throw new Error(`the coordinate ${q[none]} has no inertia at the start, and no constraint determines its acceleration [${numbers["no-inertia"]}]`);
    if (cholesky(M)) return;
    // With the constraints every acceleration may be determined.
    const Q = this.model.rows.length ? rowSpace(this.jacobian(known)) : [];
    const free = eigen(M.map((_, i) => M.map((_x, j) => Number(i === j) - Q.reduce((sum, b) => sum + b[i] * b[j], 0))));
    const Z = free.vectors.filter((_, k) => free.values[k] > 0.5);
    if (Q.length && cholesky(Z.map((a) => Z.map((b) => dot(a, M.map((row) => dot(row, b)))))))
      throw new Error(`the mass matrix is singular without the constraints at these values, for which a page in a file has no method: \`lagsim explore\` without -o has [${numbers["not-in-a-file"]}]`);
    const scale = M.map((row, j) => Math.sqrt(Math.abs(row[j])) || Math.max(...row.map(Math.abs)));
    const {values, vectors} = eigen(M.map((row, i) => row.map((x, j) => x / scale[i] / scale[j])));
    const least = Math.min(...values), along = vectors[values.indexOf(least)].map((x, j) => x / scale[j]);
    const most = Math.max(...along.map(Math.abs)), parts = along.flatMap((x, j) => Math.abs(x) > 1e-6 * most ? [q[j]] : []);
    const where = parts.length > 1 ? `a combination of the coordinates ${parts.join(", ")}` : `the coordinate ${parts[0]}`;
    if (least < -1e-12) throw new Error(`the kinetic energy falls with the speed of ${where} at the start: the mass matrix is indefinite [${numbers["negative-inertia"]}]`);
    throw new Error(`${where} has no inertia at the start, and no constraint determines its acceleration [${numbers["no-inertia"]}]`);
  }

  verdicts(known, at) {
    const {rows, defined} = this.model;
    const lengths = new Lengths(this, known);
    const nodes = rows.flatMap((x) => [x.residual, x.residualScale, x.rate, x.rateScale]);
    const found = this.graph.at([...nodes, ...defined.map((x) => x.node)], known), verdicts = [];
    rows.forEach((row, i) => {
      const [g, gScale, rate, rateScale] = found.slice(4 * i, 4 * i + 4);
      const bounds = lengths.bounds(i, g, Math.abs(gScale), Math.abs(rateScale)), of = row.holonomic ? g : rate;
      const [[bound, why], [most, whyMoving]] = [row.holonomic ? bounds.held : bounds.moving, bounds.moving];
      const held = Math.abs(of) <= bound, moves = Math.abs(rate) <= most;
      let text = "";
      if (!held) text = `constraint \`${row.name}\` has the residual ${general(of)} (bound ${general(bound, 2)}, ${why})`;
      else if (!moves) text = `the rate of constraint \`${row.name}\` is ${general(rate)} (bound ${general(most, 2)}, ${whyMoving})`;
      verdicts.push({name: row.name, text, shown: `${row.kind}; residual ${general(of, 3)}${row.holonomic ? `, of its rate ${general(rate, 3)}` : ""}`});
    });
    defined.forEach((x, k) => {
      const off = found[4 * rows.length + k] - at[x.name];
      const fails = !(Math.abs(off) <= SATISFIED * Math.max(Math.abs(at[x.name]), Math.abs(found[4 * rows.length + k])));
      verdicts.push({name: x.name, text: fails ? `the start value \`${x.name}\` is missed by ${general(off)}` : "", shown: `start value, missed by ${general(off, 3)}`});
    });
    return verdicts;
  }

  refuseUnmet(known, at, unsolved) {
    const {name, q, v, numbers} = this.model, verdicts = this.verdicts(known, at);
    const wrong = verdicts.filter((x) => x.text);
    if (!wrong.length) return;
    const lines = [`inadmissible: ${name}: ${wrong.map((x) => x.text).join("; ")} [${numbers.inadmissible}]`];
    const wide = Math.max(...verdicts.map((x) => x.name.length));
    for (const x of verdicts) lines.push(`  ${x.name.padEnd(wide)}  ${x.shown}${x.text ? "  <- violated" : ""}`);
    let near = known;
    for (const block of [0, 1]) {
      const every = q.map((_, j) => j);
      near = near && this.nearest(this.relations(block, {definitions: true, at}), near, every, this.factor(block, near, every));
    }
    const changed = near ? [...q, ...v].filter((x) => Math.abs(near[x] - known[x]) > 1e-12 * Math.max(1, Math.abs(near[x]))) : [];
    if (changed.length) lines.push("  the nearest admissible state, for `initial:`", ...changed.map((x) => `    ${x}: ${exactly(near[x])}`));
    else lines.push(unsolved ? "  no values of the guesses satisfy the constraints near there" : "  no admissible state was found near there");
    const repair = Object.fromEntries(changed.map((x) => [x, String(near[x])]));
    throw Object.assign(new Error(lines.join("\n")), changed.length ? {repair} : {});
  }

  // A constraint Jacobian with less rank than that of the file's start needs lagsim.
  refuseRank(known) {
    const {rows, q, rank, numbers} = this.model;
    if (!rows.length) return;
    const L = this.factor(0, known, q.map((_, j) => j));
    if (rowSpace(this.jacobian(known).map((row) => forward(L, row))).length < rank)
      throw new Error(`the constraints lose rank at this start, which a page in a file does not examine: \`lagsim explore\` without -o does [${numbers["not-in-a-file"]}]`);
  }

  jacobian(known) {
    const {rows, q} = this.model, values = this.graph.at(this.slopeNodes ||= rows.flatMap((x) => x.A.map(([, node]) => node)), known);
    let k = 0;
    return rows.map((x) => { const row = new Array(q.length).fill(0); for (const [j] of x.A) row[j] = values[k++]; return row; });
  }

  // The lengths of the constraint rows in the metric of M; null where M has none.
  lengths(known) {
    const L = cholesky(this.metric(known));
    return L && this.jacobian(known).map((row) => norm(forward(L, row)));
  }
}
