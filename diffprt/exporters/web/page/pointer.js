// Mouse, pen, touch and keys on the picture, told as orbit, pan, zoom and turning of the light.

const TURN = 0.0075; // radians a pixel
const KEY_STEP = 0.1; // radians
const LIGHT_STEP = 5; // degrees

export function listen(canvas, actions) {
  const pointers = new Map();

  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
    canvas.classList.add("dragging");
    actions.begin();
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => {
      pointers.delete(event.pointerId);
      if (pointers.size === 0) canvas.classList.remove("dragging");
    });
  }
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last.clientX, event.clientY - last.clientY];
    if (pointers.size === 2) {
      const [other] = [...pointers.values()].filter((p) => p.pointerId !== event.pointerId);
      const reach = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
      actions.pan(dx / 2, dy / 2);
      if (reach(event) > 1) actions.zoom(reach(last) / reach(event));
    } else if (event.shiftKey) {
      actions.turnLight(dx * 0.5, dy * 0.5);
    } else if (event.buttons & 6) {
      actions.pan(dx, dy);
    } else {
      actions.orbit(-dx * TURN, dy * TURN);
    }
    pointers.set(event.pointerId, event);
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      actions.begin();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 1 : 30;
      const step = Math.max(-240, Math.min(240, event.deltaY * lines));
      actions.zoom(Math.exp(step * (event.ctrlKey ? 0.01 : 0.0015)));
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key in arrows) {
      const [x, y] = arrows[event.key];
      event.preventDefault();
      actions.begin();
      if (event.shiftKey) actions.turnLight(x * LIGHT_STEP, -y * LIGHT_STEP);
      else actions.orbit(x * KEY_STEP, y * KEY_STEP);
    } else if ("+=-_".includes(event.key)) {
      actions.begin();
      actions.zoom("+=".includes(event.key) ? 1 / 1.1 : 1.1);
    }
  });
}
