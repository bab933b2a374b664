// Around the page in a notebook: the widget's values go into the frame, what the reader does comes out of it.
// The page's side is page/host.js.

const NAMES = { coefficients: "light", azimuth: "azimuth", elevation: "elevation", eye: "eye", target: "target" };

export default {
  render({ model, el }) {
    const frame = document.createElement("iframe");
    frame.title = "Relit asset";
    frame.setAttribute("sandbox", "allow-scripts allow-downloads");
    frame.style.cssText = `width: 100%; height: ${model.get("height")}px; border: 0`;
    frame.srcdoc = model.get("page");
    let opened = false;
    let heard = false; // while what is heard is set, nothing is said back

    const hear = (event) => {
      const told = event.source === frame.contentWindow && event.data?.diffprt;
      if (!told) return;
      // A widget that was set before it was shown, or is shown again, knows better than a page that just opened.
      if (!opened) {
        opened = true;
        if (model.get("coefficients").length > 0) return tell(Object.keys(NAMES));
      }
      heard = true;
      for (const [name, inside] of Object.entries(NAMES)) model.set(name, told[inside]);
      model.save_changes();
      heard = false;
    };
    const tell = (names) => {
      if (heard || !frame.contentWindow) return;
      const entries = Object.fromEntries(names.map((name) => [NAMES[name], model.get(name)]));
      frame.contentWindow.postMessage({ diffprt: entries }, "*");
    };
    const watched = [["coefficients"], ["azimuth"], ["elevation"], ["eye", "target"], ["target", "eye"]];
    const told = watched.map((names) => [`change:${names[0]}`, () => tell(names)]);
    for (const [event, action] of told) model.on(event, action);
    window.addEventListener("message", hear);
    el.append(frame);
    return () => {
      window.removeEventListener("message", hear);
      for (const [event, action] of told) model.off(event, action);
    };
  },
};
