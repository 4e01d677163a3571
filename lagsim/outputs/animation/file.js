// The engine of a page that holds its model: motions by a worker of the page.

// The content of a data element: compressed, in base64.
function inflated(name) {
  const bytes = Uint8Array.from(atob($(name).textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")));
}

class Engine {
  constructor() {
    this.page = JSON.parse($("model").textContent);
    this.open = new Map();
    this.count = 0;
    this.ready = this.begin();
    this.ready.catch(() => {});
  }

  async begin() {
    const [source, model, module] = await Promise.all([
      inflated("worker").text(), inflated("content").text(), inflated("module").arrayBuffer()]);
    this.worker = new Worker(URL.createObjectURL(new Blob([source], {type: "text/javascript"})));
    this.worker.onmessage = ({data: {id, found, error}}) => {
      const {done, failed} = this.open.get(id);
      this.open.delete(id);
      if (error) failed(new Error(error)); else done(found ?? null);
    };
    this.worker.onerror = (event) => {
      for (const {failed} of this.open.values()) failed(new Error(event.message || "this browser runs no WebAssembly in a worker"));
      this.open.clear();
    };
    return this.ask("open", {model, module});
  }

  ask(kind, given) {
    return new Promise((done, failed) => {
      const id = ++this.count;
      this.open.set(id, {done, failed});
      this.worker.postMessage({id, kind, ...given});
    });
  }

  async model() { await this.ready; return this.page; }

  equations() { return inflated("mathml").text(); }

  // A motion. Null: a later one has taken its place.
  motion(values) { return this.ask("motion", {values}); }

  state(values, t) { return this.ask("state", {values, t}); }

  drag(values, t, point, target) { return this.ask("drag", {values, t, point, target}); }

  start(values, name, value) { return this.ask("start", {values, name, value}); }

  file(values) { return this.ask("file", {values}); }

  // A page that holds its model sees no other.
  watch() {}
}
