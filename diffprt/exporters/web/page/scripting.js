// `window.diffprt`, to drive the page from a script.
import { FULL_ORDER, throughWindow } from "./light_window.js";
import { projectMap } from "./project_map.js";
import { readRadiance } from "./radiance_hdr.js";
import { shRotate } from "./sh.js";
import { CURVES } from "./tonemap.js";
import { PLAIN_BACKGROUNDS } from "./viewer.js";

function checkNumbers(name, values, count, remedy = "") {
  const flat = Array.from(values ?? []).flat().map(Number);
  if (flat.length !== count || !flat.every(Number.isFinite)) {
    throw new Error(`${name} has ${flat.length} numbers, ${count} finite ones are wanted${remedy}`);
  }
  return flat;
}

function versionIndex(viewer, name) {
  const names = viewer.manifest.versions.map((version) => version.name);
  if (!names.includes(name)) throw new Error(`version '${name}' is unknown: use one of ${names.join(", ")}`);
  return names.indexOf(name);
}

// The surface for scripts. Matrices are row-major; a mistake throws and changes nothing.
export function scripted(viewer) {
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
      const paths = viewer.renderer.paths(viewer.state.version);
      if (!paths.includes(path)) throw new Error(`path '${path}' is not to be had here: use one of ${paths.join(", ")}`);
      viewer.change({ path });
    },
    // The version shown, and the one right of the line at `wipe`, a share of the width; by name, null for none.
    async setVersion(name) {
      await viewer.setVersion(versionIndex(viewer, name));
    },
    async setCompare(name, wipe = 0.5) {
      await viewer.setOther(name === null ? null : versionIndex(viewer, name));
      viewer.change({ wipe: checkNumbers("wipe", [wipe], 1)[0] });
    },
    // Bands of the light that are used, 1 to the asset's order.
    setOrder(order) {
      const most = viewer.manifest.facts.order;
      if (!(Number.isInteger(order) && order >= 1 && order <= most)) {
        throw new Error(`order is ${order}: give 1 to ${most}`);
      }
      viewer.setOrder(order);
    },
    setHeat(name) {
      const names = ["none", ...viewer.renderer.heatMaps];
      if (!names.includes(name)) throw new Error(`heat map '${name}' is not to be had here: use one of ${names.join(", ")}`);
      viewer.setHeat(name);
    },
    // Coefficients of an .hdr in base64, without a window.
    projectHdr(text, order) {
      const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
      return Array.from(projectMap(readRadiance(bytes), order));
    },
    // { coefficients, window } of an .hdr in base64, as it is when dropped.
    async lightOfHdr(text) {
      const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
      const full = projectMap(readRadiance(bytes), FULL_ORDER);
      const { coefficients, window } = await throughWindow(full, viewer.manifest.facts.order, viewer.manifest);
      return { coefficients: Array.from(coefficients), window };
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
      const { title, facts, certificate, lights, versions } = viewer.manifest;
      const { light, turn, ...shown } = viewer.state;
      return {
        title,
        ...facts,
        ...versions[shown.version].facts,
        ...shown,
        certificate,
        kind: versions[shown.version].kind,
        bands: shown.order,
        order: facts.order,
        lights: lights.map(({ name }) => name),
        light: Array.from(light),
        versions: versions.map(({ name }) => name),
        paths: viewer.renderer.paths(shown.version),
        heatMaps: viewer.renderer.heatMaps,
      };
    },
  };
}
