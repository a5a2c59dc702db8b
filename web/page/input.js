// Mouse, touch and keys that move the camera: drag turns, right drag or two fingers move, wheel and pinch come nearer.

/** Pixels of wheel movement that count as a line. */
const PX_PER_LINE = 100;
/** Distance after one line, as the camera controller has it; a pinch is converted to lines. */
const DOLLY_PER_LINE = 0.88;
/** Keys of flight: axis and sign. */
const FLIGHT = { KeyD: [0, 1], KeyA: [0, -1], KeyE: [1, 1], KeyQ: [1, -1], KeyW: [2, 1], KeyS: [2, -1] };
/** Turn of an arrow key, in pixels of a drag each second. */
const ARROW_PX_PER_S = 200;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** What keys write into. A checkbox takes no letters. */
const WRITABLE = 'input:not([type=checkbox]), textarea, select, [contenteditable]';

/** Listens on a canvas. `actions`: functions by key code. `keys`: whose keys are heard, by default all of the page's. */
export function listen(view, canvas, actions, now, keys = window) {
  const pointers = new Map();
  const held = new Set();
  let flownUntil = now();
  const change = (apply) => {
    if (!view.viewer) return;
    apply(view.viewer);
    view.redraw();
  };

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener('pointermove', (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const scale = devicePixelRatio;
    const [dx, dy] = [(event.clientX - last.clientX) * scale, (event.clientY - last.clientY) * scale];
    const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    pointers.set(event.pointerId, event);
    if (other) {
      // Each finger reports by itself, so each moves the middle by half.
      const distance = (to) => Math.hypot(to.clientX - other.clientX, to.clientY - other.clientY);
      const lines = Math.log(Math.max(distance(last), 1) / Math.max(distance(event), 1)) / Math.log(DOLLY_PER_LINE);
      change((viewer) => {
        viewer.pan(now(), dx / 2, dy / 2);
        viewer.wheel(now(), lines);
      });
    } else if (event.buttons & 6 || event.ctrlKey) {
      change((viewer) => viewer.pan(now(), dx, dy));
    } else {
      change((viewer) => viewer.turn(now(), dx, dy));
    }
  });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener(
    'wheel',
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY / PX_PER_LINE : event.deltaY / 3;
      change((viewer) => viewer.wheel(now(), -lines));
    },
    { passive: false },
  );

  keys.addEventListener('keydown', (event) => {
    if (event.target.closest?.(WRITABLE) || event.metaKey || event.altKey) return;
    if (event.code in FLIGHT || event.code in ARROWS) {
      if (!held.size) flownUntil = now();
      held.add(event.code);
      event.preventDefault();
      view.redraw();
    } else if (!event.repeat && !event.ctrlKey) {
      actions[event.code]?.();
    }
    if (event.key === 'Shift') held.add('Shift');
  });
  keys.addEventListener('keyup', (event) => {
    held.delete(event.code);
    if (event.key === 'Shift') held.delete('Shift');
  });
  keys.addEventListener('blur', () => held.clear());

  view.beforeFrame = (at) => {
    const seconds = Math.min((at - flownUntil) / 1000, 1);
    flownUntil = at;
    const push = [0, 0, 0];
    const turn = [0, 0];
    for (const code of held) {
      if (code in FLIGHT) push[FLIGHT[code][0]] += FLIGHT[code][1];
      if (code in ARROWS) ARROWS[code].forEach((sign, axis) => (turn[axis] += sign * ARROW_PX_PER_S * seconds));
    }
    if (push.some(Boolean)) view.viewer.fly(at, ...push, held.has('Shift'), seconds);
    if (turn.some(Boolean)) view.viewer.turn(at, ...turn);
    return push.some(Boolean) || turn.some(Boolean);
  };
}
