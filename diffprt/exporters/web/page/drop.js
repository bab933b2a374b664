// An .hdr that is dropped on the page, or chosen, becomes a light.
import { FULL_ORDER, throughWindow } from "./light_window.js";
import { projectMap } from "./project_map.js";
import { readRadiance } from "./radiance_hdr.js";

// add(name, coefficients, window) takes the light, complain(text) what is wrong with the file.
export function listenForFiles({ manifest, add, complain }) {
  const take = async (file) => {
    if (!file) return;
    try {
      const picture = readRadiance(new Uint8Array(await file.arrayBuffer()));
      const full = projectMap(picture, FULL_ORDER);
      const { coefficients, window } = await throughWindow(full, manifest.facts.order, manifest);
      add(file.name.replace(/\.\w+$/, ""), coefficients, window);
    } catch (error) {
      complain(`${file.name}: ${error.message}; nothing was changed.`);
    }
  };
  const input = document.getElementById("map");
  document.getElementById("open-map").addEventListener("click", () => input.click());
  input.addEventListener("change", () => {
    take(input.files[0]);
    input.value = "";
  });
  document.addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  for (const name of ["dragleave", "drop"]) {
    document.addEventListener(name, () => document.body.classList.remove("dropping"));
  }
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    take(event.dataTransfer.files[0]);
  });
}
