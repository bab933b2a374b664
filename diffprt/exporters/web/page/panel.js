// The panel: reads and shows the state, and tells `actions` what the reader asked for.
import { drawBall } from "./light_ball.js";
import { asSeen } from "./light_window.js";

const element = (id) => document.getElementById(id);
const PATH_NAMES = { single: "One pass", passes: "Passes" };
const HEAT_NAMES = { none: "None", clusters: "Clusters", overdraw: "Overdraw", error: "Error" };
const whole = new Intl.NumberFormat("en");

export function formatBytes(bytes) {
  const units = ["B", "kB", "MB", "GB"];
  const step = bytes < 1000 ? 0 : Math.min(3, Math.floor(Math.log10(bytes) / 3));
  return `${step === 0 ? bytes : (bytes / 1000 ** step).toPrecision(3)} ${units[step]}`;
}

export class Panel {
  // offered: { paths, heatMaps } that this device and asset have.
  constructor(manifest, { paths, heatMaps }, actions) {
    this.actions = actions;
    this.versions = manifest.versions;
    this.facts = manifest.facts;
    this.showFacts(manifest);
    manifest.lights.forEach(({ name, coefficients, rings }) => this.addLight(name, asSeen(coefficients, rings)));
    this.buildVersions();
    this.choice("heat", ["none", ...heatMaps].map((name) => [name, HEAT_NAMES[name]]), actions.setHeat);
    this.choice("path", paths.map((name) => [name, PATH_NAMES[name]]), actions.setPath);
    element("order").max = manifest.facts.order;
    this.slider("order", actions.setOrder);
    this.slider("wipe", (value) => actions.setWipe(value / 100));
    this.slider("azimuth", (value) => actions.setLightAngles({ azimuth: value }));
    this.slider("elevation", (value) => actions.setLightAngles({ elevation: value }));
    this.slider("exposure", (value) => actions.setExposure(2 ** value));
    for (const input of document.querySelectorAll("input[name=curve]")) {
      input.addEventListener("change", () => actions.setCurve(input.value));
    }
    for (const input of document.querySelectorAll("input[name=background]")) {
      input.addEventListener("change", () => actions.chooseBackground(input.value));
    }
    const buttons = {
      spin: actions.toggleSpin,
      "reset-light": actions.resetLight,
      "reset-camera": actions.resetCamera,
      save: actions.save,
      hide: () => this.setOpen(false),
      show: () => this.setOpen(true),
    };
    for (const [id, action] of Object.entries(buttons)) element(id).addEventListener("click", () => action());
    document.addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const typing = event.target.closest?.("input, button, summary, select, textarea");
    const { actions } = this;
    const keys = { h: () => this.setOpen(element("panel").hidden), r: actions.resetCamera, l: actions.resetLight, s: actions.save };
    if (event.key === " " && !typing) {
      event.preventDefault();
      actions.toggleSpin();
    } else if (/^[1-9]$/.test(event.key)) {
      actions.chooseLight(Number(event.key) - 1);
    } else if (event.key.toLowerCase() in keys && !event.repeat) {
      keys[event.key.toLowerCase()]();
    }
  }

  slider(id, action) {
    element(id).addEventListener("input", () => action(Number(element(id).value)));
  }

  setSlider(id, value, text) {
    const input = element(id);
    input.value = value;
    const fill = (Number(input.value) - Number(input.min)) / (Number(input.max) - Number(input.min));
    input.style.setProperty("--fill", `${100 * fill}%`);
    input.setAttribute("aria-valuetext", text);
    element(`${id}-value`).textContent = text;
  }

  addLight(name, coefficients) {
    const index = element("lights").childElementCount;
    const side = Math.round(40 * Math.min(2, window.devicePixelRatio || 1));
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "radio", name: "light", value: index });
    const ball = Object.assign(document.createElement("canvas"), { width: side, height: side });
    ball.setAttribute("aria-hidden", "true");
    const text = Object.assign(document.createElement("span"), { textContent: name });
    label.title = name;
    label.append(input, ball, text);
    element("lights").append(label);
    drawBall(ball, Float32Array.from(coefficients));
    input.addEventListener("change", () => this.actions.chooseLight(index));
  }

  // Segments of a fieldset, which shows only where there is something to choose.
  choice(name, options, action) {
    const field = element(`${name}-field`);
    field.hidden = options.length < 2;
    field.querySelector(".segments").replaceChildren(
      ...options.map(([value, text]) => {
        const label = document.createElement("label");
        const input = Object.assign(document.createElement("input"), { type: "radio", name, value });
        label.append(input, Object.assign(document.createElement("span"), { textContent: text }));
        input.addEventListener("change", () => action(value));
        return label;
      }),
    );
  }

  buildVersions() {
    element("versions").hidden = this.versions.length < 2;
    const options = (list) =>
      list.map(([value, text]) => Object.assign(document.createElement("option"), { value, textContent: text }));
    const names = this.versions.map(({ name }, index) => [String(index), name]);
    element("version").replaceChildren(...options(names));
    element("other").replaceChildren(...options([["", "Nothing"], ...names]));
    element("version").addEventListener("change", (event) => this.actions.setVersion(Number(event.target.value)));
    element("other").addEventListener("change", ({ target }) =>
      this.actions.setOther(target.value === "" ? null : Number(target.value)),
    );
  }

  showFacts({ title, certificate }) {
    element("title").textContent = title;
    this.showVersion(0);
    const entries = flatten(certificate);
    element("certificate").hidden = entries.length === 0;
    fill(element("certificate").querySelector("dl"), entries);
  }

  showVersion(index) {
    if (this.shownVersion === index) return;
    this.shownVersion = index;
    const facts = { ...this.facts, clusters: undefined, ...this.versions[index].facts };
    const held = facts.signal_bytes ? formatBytes(facts.signal_bytes) : "from normals";
    const rows = [
      ["Vertices", whole.format(facts.vertices)],
      ["Triangles", whole.format(facts.triangles)],
      ["Order", `${facts.order} (K = ${facts.order ** 2})`],
      ["Channels", facts.channels === 1 ? "1, uncolored" : "3, colored"],
    ];
    if (facts.clusters) rows.push(["Clusters × components", `${whole.format(facts.clusters)} × ${facts.components}`]);
    if (facts.passes) rows.push(["Passes, overdraw", `${facts.passes}, ${facts.overdraw.toFixed(3)}`]);
    rows.push(["Signal", held]);
    if (facts.signal_bytes) rows.push(["in this file", formatBytes(facts.stored_bytes)]);
    rows.push(["Geometry", formatBytes(facts.geometry_bytes)], ["Frame", this.frameTime?.textContent ?? "–"]);
    fill(element("facts"), rows);
    this.frameTime = element("facts").lastElementChild;
    this.frameTime.id = "frame-time";
    const size = facts.clusters ? `${whole.format(facts.clusters)} × ${facts.components} clusters` : "plain transfer";
    element("subtitle").textContent = `${whole.format(facts.vertices)} vertices, ${size}`;
  }

  show(state) {
    this.setSlider("azimuth", state.azimuth, `${Math.round(state.azimuth)}°`);
    this.setSlider("elevation", state.elevation, `${Math.round(state.elevation)}°`);
    const stops = Math.log2(state.exposure);
    this.setSlider("exposure", stops, `${stops < -0.005 ? "−" : "+"}${Math.abs(stops).toFixed(2)} EV`);
    element("spin").setAttribute("aria-pressed", String(state.spinning));
    this.setSlider("order", state.order, `${state.order} of ${this.facts.order}`);
    this.setSlider("wipe", 100 * state.wipe, `${Math.round(100 * state.wipe)} %`);
    element("wipe-field").hidden = state.other === null;
    element("version").value = String(state.version);
    element("other").value = state.other === null ? "" : String(state.other);
    this.showVersion(state.version);
    check("heat", state.heat);
    check("path", state.path);
    check("curve", state.curve);
    check("background", String(state.background));
    check("light", String(state.lightIndex));
  }

  setOpen(open) {
    const held = document.activeElement;
    element("panel").hidden = !open;
    element("show").hidden = open;
    element("show").setAttribute("aria-expanded", String(open));
    if (held && held !== document.body && held !== element("view")) element(open ? "hide" : "show").focus();
    this.actions.layout();
  }

  // The part of the window that the panel leaves free.
  free(width, height) {
    const whole = { x: 0, y: 0, width, height };
    if (element("panel").hidden) return whole;
    const box = element("panel").getBoundingClientRect();
    if (box.width > 0.6 * width) return box.top > 80 ? { ...whole, height: box.top } : whole;
    return box.left > 80 ? { ...whole, width: box.left } : whole;
  }
}

function check(name, value) {
  for (const input of document.querySelectorAll(`input[name=${name}]`)) input.checked = input.value === value;
}

function fill(list, rows) {
  list.replaceChildren(
    ...rows.flatMap(([term, value]) => [
      Object.assign(document.createElement("dt"), { textContent: term }),
      Object.assign(document.createElement("dd"), { textContent: value }),
    ]),
  );
}

// { image: { rmse: 0.0123 } } becomes [["image rmse", "0.0123"]].
function flatten(entries, prefix = "") {
  return Object.entries(entries ?? {}).flatMap(([key, value]) => {
    const name = `${prefix}${key.replaceAll("_", " ")}`;
    if (value !== null && typeof value === "object" && !Array.isArray(value)) return flatten(value, `${name} `);
    const number = typeof value === "number" && !Number.isInteger(value);
    return [[name, number ? String(Number(value.toPrecision(4))) : Array.isArray(value) ? value.join(", ") : String(value)]];
  });
}
