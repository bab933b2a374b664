// Starts the page, and shows why where it cannot.
import { answerHost } from "./host.js";
import { sentence, showMessage } from "./message.js";
import { scripted } from "./scripting.js";
import { Viewer } from "./viewer.js";

window.addEventListener("error", (event) => showMessage(sentence(event.error ?? event.message), true));
window.addEventListener("unhandledrejection", (event) => showMessage(sentence(event.reason), true));

async function start() {
  // After a paint, so that a large asset shows that it is loading.
  await new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
  try {
    const viewer = await Viewer.open();
    viewer.change({});
    const api = scripted(viewer);
    Object.defineProperties(window.diffprt, Object.getOwnPropertyDescriptors(api));
    document.getElementById("loading").hidden = true;
    document.getElementById("fallback").remove();
    answerHost(viewer, api);
    return api.info;
  } catch (error) {
    document.getElementById("panel").hidden = true;
    document.getElementById("fallback").hidden = false;
    showMessage(sentence(error));
    throw error;
  }
}

window.diffprt = { ready: start() };
window.diffprt.ready.catch(() => {}); // shown already
