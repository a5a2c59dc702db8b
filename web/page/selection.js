// The part that was clicked, and what keys do to it, as in the viewer's window.

/** Colour of the selected part. */
const COLOR = '#ff8c00';
/** Movement of the pointer, in CSS pixels, from which on a click is a drag. */
const CLICK_PX = 4;

/** Selects parts of a view by clicks on its canvas. */
export class Selection {
  #view;
  #selected = null;

  constructor(view, canvas) {
    this.#view = view;
    let pressed = null;
    canvas.addEventListener('pointerdown', (event) => {
      // A second finger makes it a gesture.
      pressed = event.isPrimary && event.button === 0 ? event : null;
    });
    canvas.addEventListener('pointerup', (event) => {
      const from = event.pointerId === pressed?.pointerId ? pressed : null;
      pressed = null;
      if (!from || Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) >= CLICK_PX) return;
      const { left, top } = canvas.getBoundingClientRect();
      this.#pick((event.clientX - left) * devicePixelRatio, (event.clientY - top) * devicePixelRatio);
    });
  }

  /** The selected part: `{ instance, part }`; null without one. */
  get selected() {
    return this.#selected;
  }

  async #pick(x, y) {
    const found = await this.#view.parts.pick(x, y);
    this.#select(found && { instance: found.instance, part: found.part });
  }

  #select(part) {
    const { parts } = this.#view;
    if (this.#selected) parts.tint(this.#selected.instance, this.#selected.part, null);
    if (part) parts.tint(part.instance, part.part, COLOR);
    this.#selected = part;
  }

  hide() {
    const part = this.#selected;
    if (!part) return;
    this.#select(null);
    this.#view.parts.hide(part.instance, part.part);
  }

  isolate() {
    if (this.#selected) this.#view.parts.isolate([this.#selected]);
  }

  showAll() {
    this.#selected = null;
    this.#view.parts.showAll();
  }

  fit() {
    if (this.#selected) this.#view.parts.fit(this.#selected.instance, this.#selected.part);
  }
}
