// The page's state, drawn when it changes.
import { listenForFiles } from "./drop.js";
import { FrameClock } from "./frame_clock.js";
import { showLegend } from "./legend.js";
import { asSeen, peakOf } from "./light_window.js";
import { lightTurn } from "./matrix.js";
import { showMessage } from "./message.js";
import { Orbit } from "./orbit.js";
import { Panel } from "./panel.js";
import { encodeBase64, readArray, readManifest, readVersion } from "./payload.js";
import { listen } from "./pointer.js";
import { Renderer } from "./renderer.js";
import { shRotate } from "./sh.js";
import { srgbEncode, toneMap } from "./tonemap.js";
import { Wipe } from "./wipe.js";

const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const SPIN_SPEED = 30; // degrees a second
export const PLAIN_BACKGROUNDS = { grey: [0.2, 0.2, 0.2], dark: [0.012, 0.013, 0.016] }; // linear, whatever the exposure

export class Viewer {
  static async open() {
    const manifest = readManifest();
    const renderer = new Renderer(document.getElementById("view"));
    const error = manifest.heat.error ? await readArray(manifest, manifest.heat.error) : null;
    renderer.heat = { error, most: manifest.heat.most };
    renderer.addVersion(0, await readVersion(manifest, 0));
    return new Viewer(manifest, renderer);
  }

  constructor(manifest, renderer) {
    this.canvas = document.getElementById("view");
    this.manifest = manifest;
    this.renderer = renderer;
    this.coefficients = manifest.facts.order ** 2 * 3;
    this.lights = manifest.lights.map(({ coefficients }) => Float64Array.from(coefficients));
    this.ringing = manifest.lights.map(({ rings }) => rings); // those whose sky is drawn through a window
    this.clock = new FrameClock(this.renderer.gl);
    this.orbit = new Orbit(manifest.camera, manifest.bounds);
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    this.fixedCamera = null;
    this.fixedSize = null;
    this.onDraw = () => {};
    this.state = {
      light: this.lights[0],
      lightIndex: 0,
      azimuth: 0,
      elevation: 0,
      turn: IDENTITY,
      order: manifest.facts.order, // bands of the light that are used
      exposure: manifest.exposure,
      curve: manifest.curve,
      background: "light", // a name the panel knows, or radiance [r, g, b]
      spinning: false,
      version: 0,
      other: null, // the version to the right of the wipe
      wipe: 0.5,
      heat: "none",
      path: this.usualPath(),
    };
    this.lightChanged = true;
    this.panel = new Panel(manifest, { paths: renderer.paths(0), heatMaps: renderer.heatMaps }, this.actions());
    this.wipe = new Wipe(this.actions());
    listen(this.canvas, this.actions());
    listenForFiles({
      manifest,
      add: (name, coefficients, window) => this.addLight(name, coefficients, window === "none"),
      complain: (text) => showMessage(text, true),
    });
    this.watchContext();
    new ResizeObserver(() => this.layout()).observe(this.canvas);
    new ResizeObserver(() => this.layout()).observe(document.getElementById("panel"));
    this.layout();
  }

  // What the export asked for, where this device can do it.
  usualPath() {
    const paths = this.renderer.paths(0);
    return paths.includes(this.manifest.path) ? this.manifest.path : paths[0];
  }

  actions() {
    return {
      begin: () => {
        this.fixedCamera = null;
      },
      orbit: (azimuth, elevation) => this.move(() => this.orbit.turn(azimuth, elevation)),
      zoom: (factor) => this.move(() => this.orbit.zoom(factor)),
      pan: (dx, dy) => this.move(() => this.orbit.pan(dx, dy, this.free())),
      turnLight: (azimuth, elevation) => {
        const { state } = this;
        this.setLightAngles({ azimuth: state.azimuth + azimuth, elevation: state.elevation + elevation });
      },
      setLightAngles: (angles) => this.setLightAngles(angles),
      resetLight: () => this.setLightAngles({ azimuth: 0, elevation: 0 }),
      resetCamera: () => {
        this.fixedCamera = null;
        this.orbit.lookAt(this.manifest.camera);
        this.redraw();
      },
      chooseLight: (index) => {
        if (index < this.lights.length) this.setLight(this.lights[index], index);
      },
      setExposure: (exposure) => this.change({ exposure }),
      setCurve: (curve) => this.change({ curve }),
      setOrder: (order) => this.setOrder(order),
      setPath: (path) => this.change({ path }),
      setHeat: (heat) => this.setHeat(heat),
      setVersion: (index) => this.setVersion(index),
      setOther: (index) => this.setOther(index),
      setWipe: (wipe) => this.change({ wipe: Math.min(1, Math.max(0, wipe)) }),
      chooseBackground: (name) => this.change({ background: name }),
      toggleSpin: () => this.change({ spinning: !this.state.spinning }),
      save: () => this.save(),
      layout: () => this.layout(),
    };
  }

  change(entries) {
    Object.assign(this.state, entries);
    this.panel.show(this.state);
    this.showWipe();
    this.redraw();
  }

  showWipe() {
    const { version, other, wipe } = this.state;
    const name = (index) => this.manifest.versions[index].name;
    this.wipe.show(name(version), other === null ? null : name(other), wipe);
  }

  // Versions other than the first are read when they are first asked for.
  async need(index) {
    if (!this.renderer.assets.has(index)) this.renderer.addVersion(index, await readVersion(this.manifest, index));
  }

  async setVersion(version) {
    await this.need(version);
    this.change({ version, heat: "none" });
  }

  async setOther(other) {
    if (other !== null) await this.need(other);
    this.change({ other });
  }

  setHeat(heat) {
    const { assets, heat: values } = this.renderer;
    showLegend(document.getElementById("legend"), heat, assets.get(0), values);
    this.change({ heat });
  }

  setOrder(order) {
    this.lightChanged = true;
    this.change({ order });
  }

  // Maps come in any unit: the new light is made as bright on average as the first one, or less where its sky would
  // be white.
  addLight(name, coefficients, rings) {
    const mean = (light) => Math.abs(light[0] + light[1] + light[2]);
    const { white, exposure } = this.manifest;
    const peak = peakOf(asSeen(coefficients, rings)) * exposure;
    const alike = mean(coefficients) > 0 ? mean(this.lights[0]) / mean(coefficients) : 1;
    const factor = peak > 0 ? Math.min(alike, white[this.state.curve] / peak) : alike;
    const light = coefficients.map((value) => value * factor);
    this.lights.push(light);
    this.ringing.push(rings);
    this.panel.addLight(name, asSeen(light, rings));
    this.setLight(light, this.lights.length - 1);
  }

  move(action) {
    action();
    if (this.calm.matches) this.orbit.arrive();
    this.redraw();
  }

  setLight(light, lightIndex = -1) {
    this.lightChanged = true;
    this.change({ light, lightIndex });
  }

  setLightAngles(angles) {
    const wrap = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;
    const azimuth = angles.azimuth === 180 ? 180 : wrap(angles.azimuth ?? this.state.azimuth);
    const elevation = angles.elevation === 180 ? 180 : wrap(angles.elevation ?? this.state.elevation);
    this.lightChanged = true;
    this.change({ azimuth, elevation, turn: lightTurn(azimuth, elevation) });
  }

  free() {
    const { clientWidth, clientHeight } = this.canvas;
    if (this.fixedSize) return { x: 0, y: 0, ...this.fixedSize };
    return this.panel.free(clientWidth, clientHeight);
  }

  layout() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const size = this.fixedSize ?? {
      width: Math.max(1, Math.round(clientWidth * ratio)),
      height: Math.max(1, Math.round(clientHeight * ratio)),
    };
    this.canvas.style.width = this.fixedSize ? `${size.width / ratio}px` : "";
    this.canvas.style.height = this.fixedSize ? `${size.height / ratio}px` : "";
    if (this.canvas.width !== size.width || this.canvas.height !== size.height) Object.assign(this.canvas, size);
    this.draw(); // at once: a resized canvas is empty until then
  }

  redraw() {
    this.scheduled ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.scheduled = undefined;
    const seconds = Math.min(0.1, (now - (this.lastFrame ?? now)) / 1000);
    const gliding = this.orbit.glide(seconds || 1 / 60);
    if (this.state.spinning) this.setLightAngles({ azimuth: this.state.azimuth + SPIN_SPEED * seconds });
    this.clock.begin();
    this.draw();
    this.clock.end();
    this.reportTime(now);
    if (gliding || this.state.spinning) {
      this.lastFrame = now;
      this.redraw();
    } else {
      this.lastFrame = undefined;
    }
  }

  // The GPU answers late: ask again when no further frame will.
  reportTime(now) {
    const waiting = this.clock.poll();
    if (waiting && !this.scheduled) setTimeout(() => this.reportTime(performance.now()), 100);
    if (waiting || now - (this.lastReport ?? -Infinity) < 200) return;
    this.lastReport = now;
    this.panel.frameTime.textContent = this.clock.text;
  }

  draw() {
    const { renderer, canvas } = this;
    if (renderer.gl.isContextLost()) return;
    renderer.draw(this.picture(), canvas.width, canvas.height);
    this.onDraw();
  }

  picture() {
    const { state, canvas } = this;
    if (this.lightChanged) {
      // Harmonics of an order are whole bands: fewer of the light's are as good as fewer of the transfer's.
      const light = shRotate(state.light, state.turn).fill(0, 3 * state.order ** 2);
      this.renderer.setLight(light, asSeen(light, this.ringing[state.lightIndex]));
      this.lightChanged = false;
    }
    const size = this.fixedSize ?? { width: canvas.clientWidth || 1, height: canvas.clientHeight || 1 };
    const matrices = this.fixedCamera ?? this.orbit.matrices(size.width, size.height, this.free());
    const { exposure, curve, path, version, other, wipe, heat } = state;
    return { ...matrices, exposure, curve, path, version, other, wipe, heat, background: this.background() };
  }

  background() {
    const { background, exposure, curve } = this.state;
    if (Array.isArray(background)) return background.map((x) => toneMap(x, exposure, curve));
    return PLAIN_BACKGROUNDS[background]?.map(srgbEncode) ?? background;
  }

  pixels() {
    const { width, height } = this.canvas;
    const bytes = this.renderer.pixels(this.picture(), width, height);
    return { width, height, data: encodeBase64(bytes) };
  }

  timeFrames(count, turning) {
    const { gl } = this.renderer;
    const pixel = new Uint8Array(4);
    const times = [];
    for (let i = 0; i < count; i++) {
      const begun = performance.now();
      if (turning) this.setLightAngles({ azimuth: this.state.azimuth + 1 });
      this.draw();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until all is drawn
      times.push(performance.now() - begun);
    }
    return times;
  }

  save() {
    this.draw(); // the drawing buffer holds its content only until the browser has shown it
    this.canvas.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${this.manifest.title.replace(/[^\w-]+/g, "-") || "diffprt"}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }

  watchContext() {
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      showMessage("The graphics context was lost; waiting for the browser to give it back.");
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.renderer.build();
      this.clock.restart();
      this.lightChanged = true;
      showMessage("");
      this.redraw();
    });
  }
}
