// What the colors of a heat map mean.
import { clusterColor, cssColor, PASS_COLORS, rampColor } from "./heat_colors.js";
import { overdrawOf } from "./heat_map.js";

// Fills `box`; asset: { arrays, numbers }, heat: { most }.
export function showLegend(box, name, { arrays, numbers }, heat) {
  box.hidden = name === "none";
  if (name === "none") return box.replaceChildren();
  if (name === "error") {
    const stops = [0, 0.25, 0.5, 0.75, 1].map((share) => cssColor(rampColor(share)));
    const bar = Object.assign(document.createElement("div"), { className: "ramp" });
    bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    const ends = Object.assign(document.createElement("div"), { className: "ends" });
    ends.append(line("0"), line(`${heat.most.toPrecision(2)} and more`));
    return box.replaceChildren(line("Squared error of a vertex's transfer"), bar, ends);
  }
  if (name === "clusters") {
    const colors = Array.from({ length: Math.min(numbers.clusters, 8) }, (_, m) => swatch(clusterColor(m)));
    const row = Object.assign(document.createElement("div"), { className: "swatches" });
    row.append(...colors);
    return box.replaceChildren(line(`${numbers.clusters} clusters, a color each`), row);
  }
  const counts = overdrawOf(arrays);
  const share = [1, 2, 3].map((n) => counts.reduce((sum, count) => sum + (count === n), 0) / counts.length);
  const mean = share[0] + 2 * share[1] + 3 * share[2];
  const what = arrays.passes ? "passes" : "clusters";
  const rows = share.map((value, i) => {
    const row = Object.assign(document.createElement("div"), { className: "entry" });
    const unit = i === 0 ? what.replace(/e?s$/, (end) => (what === "passes" ? "" : end.slice(0, -1))) : what;
    row.append(swatch(PASS_COLORS[i]), line(`${i + 1} ${unit}`), line(`${(100 * value).toFixed(1)} %`));
    return row;
  });
  return box.replaceChildren(line(`Of a triangle: ${mean.toFixed(3)} ${what} on average`), ...rows);
}

function line(text) {
  return Object.assign(document.createElement("span"), { textContent: text });
}

function swatch(color) {
  const box = Object.assign(document.createElement("i"), { className: "swatch" });
  box.style.background = cssColor(color);
  return box;
}
