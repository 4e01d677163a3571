// The engine of a page that holds its model: motions by a worker of the page.

class Engine {
  constructor() {
    this.open = new Map();
    this.count = 0;
    this.ready = this.begin();
    this.ready.catch(() => {});
  }

  async begin() {
    const {parts} = window;
    this.worker = await parts.worker;
    this.worker.onmessage = ({data: {id, found, error}}) => {
      const {done, failed} = this.open.get(id);
      this.open.delete(id);
      if (error) failed(new Error(error)); else done(found ?? null);
    };
    this.worker.onerror = (event) => {
      for (const {failed} of this.open.values()) failed(new Error(event.message || "this browser runs no WebAssembly in a worker"));
      this.open.clear();
    };
    const [model, module] = await Promise.all([parts.content, parts.module]);
    return this.ask("open", {model, module});
  }

  ask(kind, given) {
    return new Promise((done, failed) => {
      const id = ++this.count;
      this.open.set(id, {done, failed});
      this.worker.postMessage({id, kind, ...given});
    });
  }

  async model() { await this.ready; return window.parts.page; }

  equations() { return window.parts.mathml(); }

  // A motion. Null: a later one has taken its place.
  motion(values, follow) { return this.ask("motion", {values, follow}); }

  state(values, t) { return this.ask("state", {values, t}); }

  drag(values, t, point, target) { return this.ask("drag", {values, t, point, target}); }

  start(values, name, value) { return this.ask("start", {values, name, value}); }

  file(values) { return this.ask("file", {values}); }

  // A page that holds its model sees no other.
  watch() {}
}
