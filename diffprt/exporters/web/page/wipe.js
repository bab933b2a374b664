// The line between two versions side by side, which the reader drags.

export class Wipe {
  constructor(actions) {
    this.handle = document.getElementById("wipe-handle");
    this.handle.addEventListener("pointerdown", (event) => {
      this.handle.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    this.handle.addEventListener("pointermove", (event) => {
      if (this.handle.hasPointerCapture(event.pointerId)) actions.setWipe(event.clientX / window.innerWidth);
    });
  }

  // Names of the left and right versions; `place` is a share of the window's width.
  show(left, right, place) {
    this.handle.hidden = right === null;
    if (right === null) return;
    this.handle.style.left = `${100 * place}%`;
    this.handle.querySelector(".left").textContent = left;
    this.handle.querySelector(".right").textContent = right;
  }
}
