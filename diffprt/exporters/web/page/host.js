// A page in a frame tells its host what the reader did, and does what the host asks: diffprt/exporters/web/notebook.py.

const REPORT_PAUSE = 100; // milliseconds between reports

// Reports are { light, azimuth, elevation, eye, target }; the host asks with any of these.
export function answerHost(viewer, api) {
  if (window.parent === window) return;
  let known = "";
  let waiting = false;
  const report = () => {
    waiting = false;
    const { light, azimuth, elevation } = viewer.state;
    const entries = { light: Array.from(light), azimuth, elevation, ...viewer.orbit.camera() };
    const text = JSON.stringify(entries);
    if (text === known) return;
    known = text;
    window.parent.postMessage({ diffprt: entries }, "*");
  };
  window.addEventListener("message", (event) => {
    const asked = event.source === window.parent && event.data?.diffprt;
    if (!asked) return;
    if (asked.light) api.setLight(asked.light);
    if ("azimuth" in asked || "elevation" in asked) viewer.setLightAngles(asked);
    if (asked.eye && asked.target) api.setCameraLookAt({ eye: asked.eye, target: asked.target });
  });
  viewer.onDraw = () => {
    if (!waiting) setTimeout(report, REPORT_PAUSE);
    waiting = true;
  };
  report();
}
