// How long a frame takes to draw: asked of the GPU where the browser allows it, else by waiting for a pixel.

const KEPT = 15;
const PAUSE = 250; // milliseconds between waits, so that waiting does not slow what it measures

export class FrameClock {
  constructor(gl) {
    this.gl = gl;
    this.samples = [];
    this.restart();
  }

  restart() {
    this.timer = this.gl.getExtension("EXT_disjoint_timer_query_webgl2");
    this.query = null; // open around the present frame
    this.pending = null; // closed, not yet answered
    this.waited = -Infinity;
  }

  begin() {
    const { gl, timer } = this;
    this.start = performance.now();
    if (timer && !this.pending) {
      this.query = gl.createQuery();
      gl.beginQuery(timer.TIME_ELAPSED_EXT, this.query);
    }
  }

  end() {
    const { gl, timer } = this;
    if (this.query) {
      gl.endQuery(timer.TIME_ELAPSED_EXT);
      [this.pending, this.query] = [this.query, null];
    } else if (!timer && this.start - this.waited > PAUSE) {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      this.waited = performance.now();
      this.add(this.waited - this.start);
    }
  }

  // True while an answer is awaited.
  poll() {
    const { gl, pending } = this;
    if (!pending || gl.isContextLost()) return false;
    if (!gl.getQueryParameter(pending, gl.QUERY_RESULT_AVAILABLE)) return true;
    if (!gl.getParameter(this.timer.GPU_DISJOINT_EXT)) this.add(gl.getQueryParameter(pending, gl.QUERY_RESULT) / 1e6);
    gl.deleteQuery(pending);
    this.pending = null;
    return false;
  }

  add(milliseconds) {
    this.samples.push(milliseconds);
    if (this.samples.length > KEPT) this.samples.shift();
  }

  get text() {
    if (this.samples.length === 0) return "–";
    const median = [...this.samples].sort((a, b) => a - b)[this.samples.length >> 1];
    return `${median < 10 ? median.toFixed(2) : median.toFixed(1)} ms`;
  }
}
