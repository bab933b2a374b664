// The page: one state, drawn when it changes, and `window.diffprt` to drive it from a script.
import { FrameClock } from "./frame_clock.js";
import { lightTurn } from "./matrix.js";
import { Orbit } from "./orbit.js";
import { Panel } from "./panel.js";
import { encodeBase64, readArrays, readManifest } from "./payload.js";
import { listen } from "./pointer.js";
import { Renderer } from "./renderer.js";
import { shRotate } from "./sh.js";
import { CURVES, srgbEncode, toneMap } from "./tonemap.js";

const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const SPIN_SPEED = 30; // degrees a second
const PLAIN_BACKGROUNDS = { grey: [0.2, 0.2, 0.2], dark: [0.012, 0.013, 0.016] }; // linear, whatever the exposure

function showMessage(text, dismissible = false) {
  const box = document.getElementById("message");
  box.hidden = text === "";
  box.querySelector("p").textContent = text;
  const button = box.querySelector("button");
  button.hidden = !dismissible;
  button.onclick = () => showMessage("");
  document.getElementById("loading").hidden = true;
}

function sentence(error) {
  const text = String(error?.message ?? error);
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
}

class Viewer {
  constructor() {
    this.canvas = document.getElementById("view");
    const manifest = readManifest();
    const { kind, numbers } = manifest;
    const asset = { kind, numbers, arrays: readArrays(manifest) };
    this.manifest = manifest;
    this.coefficients = manifest.facts.order ** 2 * 3;
    this.lights = manifest.lights.map(({ coefficients }) => Float64Array.from(coefficients));
    this.renderer = new Renderer(this.canvas, asset);
    this.clock = new FrameClock(this.renderer.gl);
    this.orbit = new Orbit(manifest.camera, manifest.bounds);
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    this.fixedCamera = null;
    this.fixedSize = null;
    this.state = {
      light: this.lights[0],
      lightIndex: 0,
      azimuth: 0,
      elevation: 0,
      turn: IDENTITY,
      exposure: manifest.exposure,
      curve: manifest.curve,
      background: "light", // a name the panel knows, or radiance [r, g, b]
      spinning: false,
      path: this.usualPath(),
    };
    this.lightChanged = true;
    this.panel = new Panel(manifest, this.actions());
    listen(this.canvas, this.actions());
    this.watchContext();
    new ResizeObserver(() => this.layout()).observe(this.canvas);
    new ResizeObserver(() => this.layout()).observe(document.getElementById("panel"));
    this.layout();
  }

  // What the export asked for, where this device can do it.
  usualPath() {
    const { paths } = this.renderer;
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
      chooseBackground: (name) => this.change({ background: name }),
      toggleSpin: () => this.change({ spinning: !this.state.spinning }),
      save: () => this.save(),
      layout: () => this.layout(),
    };
  }

  change(entries) {
    Object.assign(this.state, entries);
    this.panel.show(this.state);
    this.redraw();
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
  }

  picture() {
    const { state, canvas } = this;
    if (this.lightChanged) {
      this.renderer.setLight(shRotate(state.light, state.turn));
      this.lightChanged = false;
    }
    const size = this.fixedSize ?? { width: canvas.clientWidth || 1, height: canvas.clientHeight || 1 };
    const matrices = this.fixedCamera ?? this.orbit.matrices(size.width, size.height, this.free());
    const { exposure, curve, path } = state;
    return { ...matrices, exposure, curve, path, background: this.background() };
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

function checkNumbers(name, values, count, remedy = "") {
  const flat = Array.from(values ?? []).flat().map(Number);
  if (flat.length !== count || !flat.every(Number.isFinite)) {
    throw new Error(`${name} has ${flat.length} numbers, ${count} finite ones are wanted${remedy}`);
  }
  return flat;
}

// The surface for scripts. Matrices are row-major; a mistake throws and changes nothing.
function scripted(viewer) {
  return {
    // [K * 3] row-major or [[r, g, b], ...], in the conventions of diffprt/sh.
    setLight(coefficients) {
      const { order } = viewer.manifest.facts;
      const count = Array.from(coefficients ?? []).flat().length / 3;
      if (count !== order ** 2) {
        throw new Error(
          `transfer has ${order ** 2} SH coefficients, light has ${count}: project the light with order=${order}`,
        );
      }
      viewer.setLight(Float64Array.from(checkNumbers("light", coefficients, viewer.coefficients)));
    },
    // Any rotation matrix; the sliders go back to zero and start from the unturned light.
    setLightRotation(rotation) {
      const turn = checkNumbers("rotation", rotation, 9);
      viewer.lightChanged = true;
      viewer.change({ azimuth: 0, elevation: 0, turn });
    },
    // Exact matrices for the whole picture, until the reader moves the camera.
    setCamera({ view, projection }) {
      viewer.fixedCamera = {
        view: checkNumbers("view", view, 16),
        projection: checkNumbers("projection", projection, 16),
      };
      viewer.redraw();
    },
    // The camera that the reader moves: { eye, target, up, fov [degrees], aspect }, the last three optional.
    setCameraLookAt(camera) {
      checkNumbers("eye", camera.eye, 3);
      checkNumbers("target", camera.target, 3);
      viewer.fixedCamera = null;
      viewer.orbit.lookAt(camera);
      viewer.redraw();
    },
    setExposure(exposure) {
      const [value] = checkNumbers("exposure", [exposure], 1);
      if (value <= 0) throw new Error(`exposure is ${value}: give a positive factor`);
      viewer.change({ exposure: value });
    },
    setCurve(curve) {
      if (!CURVES.includes(curve)) throw new Error(`tone curve '${curve}' is unknown: use one of ${CURVES.join(", ")}`);
      viewer.change({ curve });
    },
    // How clusters are drawn: "single", or "passes" where the asset was exported with registers and the device can.
    setPath(path) {
      const { paths } = viewer.renderer;
      if (!paths.includes(path)) throw new Error(`path '${path}' is not to be had here: use one of ${paths.join(", ")}`);
      viewer.change({ path });
    },
    // Milliseconds of `count` frames, each drawn whole; with `turning`, under a light turned a little further.
    timeFrames: (count, turning = false) => viewer.timeFrames(count, turning),
    // Radiance [r, g, b], tone-mapped like the asset, or "light", "grey" or "dark".
    setBackground(background) {
      const named = background === "light" || Object.hasOwn(PLAIN_BACKGROUNDS, background);
      viewer.change({ background: named ? background : checkNumbers("background", background, 3) });
    },
    // Size of the picture in pixels whatever the window's; without arguments it follows the window again.
    resize(width, height) {
      const limit = viewer.renderer.gl.getParameter(viewer.renderer.gl.MAX_RENDERBUFFER_SIZE);
      if (width !== undefined && !(width >= 1 && height >= 1 && width <= limit && height <= limit)) {
        throw new Error(`size is ${width} x ${height}: give 1 to ${limit} pixels a side`);
      }
      viewer.fixedSize = width === undefined ? null : { width: Math.round(width), height: Math.round(height) };
      viewer.layout();
    },
    // { width, height, data }: RGBA, 8 bits, top row first, in base64; one sample a pixel, alpha 0 off the asset.
    pixels: () => viewer.pixels(),
    rotateCoefficients: (coefficients, rotation) => Array.from(shRotate(Float64Array.from(coefficients), rotation)),
    get info() {
      const { title, kind, facts, certificate, lights } = viewer.manifest;
      const { azimuth, elevation, exposure, curve, background, lightIndex, spinning, path } = viewer.state;
      const shown = { azimuth, elevation, exposure, curve, background, spinning, lightIndex, path };
      const names = lights.map(({ name }) => name);
      return { title, kind, ...facts, certificate, lights: names, ...shown, paths: viewer.renderer.paths };
    },
  };
}

window.addEventListener("error", (event) => showMessage(sentence(event.error ?? event.message), true));
window.addEventListener("unhandledrejection", (event) => showMessage(sentence(event.reason), true));

window.diffprt = {
  ready: new Promise((resolve, reject) => {
    // After a paint, so that a large asset shows that it is loading.
    requestAnimationFrame(() =>
      setTimeout(() => {
        try {
          const viewer = new Viewer();
          viewer.change({});
          Object.defineProperties(window.diffprt, Object.getOwnPropertyDescriptors(scripted(viewer)));
          document.getElementById("loading").hidden = true;
          resolve(window.diffprt.info);
        } catch (error) {
          document.getElementById("panel").hidden = true;
          showMessage(sentence(error));
          reject(error);
        }
      }),
    );
  }),
};
window.diffprt.ready.catch(() => {}); // shown already
