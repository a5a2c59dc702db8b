// The overlay: progress, link, quality, and switches of the techniques.

const TECHNIQUES = {
  occlusion: 'ambient occlusion',
  shadows: 'shadows',
  relief: 'relief',
  lights: 'lamps',
  water: 'water',
  haze: 'haze',
  smoothing: 'smooth edges',
  adapt: 'faster while moving',
};

const size = (bytes) => (bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(2)} MB`);
const seconds = (ms) => (ms === null || ms === undefined ? '–' : `${(ms / 1e3).toFixed(2)} s`);

/** Builds the switches and shows a view's progress. */
export function show(view, element, actions) {
  const [status, bar, figures, switches] = ['status', 'bar', 'figures', 'switches'].map((name) =>
    element.querySelector(`.${name}`),
  );
  for (const [name, label] of Object.entries(TECHNIQUES)) {
    const input = Object.assign(document.createElement('input'), { type: 'checkbox', checked: true });
    input.addEventListener('change', () => view.switch(name, input.checked));
    const line = document.createElement('label');
    line.append(input, ` ${label}`);
    switches.append(line);
  }
  const buttons = { picture: actions.KeyP, screen: actions.KeyV, start: actions.KeyR, play: actions.KeyK };
  for (const [name, act] of Object.entries(buttons)) {
    element.querySelector(`.${name}`).addEventListener('click', act);
  }
  element.querySelector('.screen').hidden = !document.fullscreenEnabled;
  const play = element.querySelector('.play');
  view.addEventListener('clip', ({ detail: { clip, plays } }) => {
    play.hidden = clip === undefined;
    play.textContent = plays ? 'Pause' : 'Play';
  });

  let last = null;
  let rate = 0;
  view.addEventListener('progress', ({ detail: stats }) => {
    const at = performance.now();
    if (last && at - last.at >= 400) {
      rate = (8e3 * (stats.bytes - last.bytes)) / (at - last.at);
      last = null;
    }
    last ??= { at, bytes: stats.bytes ?? 0 };
    const left = Math.max(0, stats.missing_bytes ?? 0);
    const share = left ? (stats.needed_bytes - left) / Math.max(stats.needed_bytes, 1) : 1;
    bar.value = stats.settled ? 1 : Math.max(0, Math.min(share, 0.99));
    const time = rate > 0 ? `, ${((8 * left) / rate).toFixed(1)} s left` : '';
    const toCome = left ? `: ${size(left)} to come${time}` : '';
    const stage = stats.settled ? 'settled' : stats.ttff_ms === null ? 'loading' : 'refining';
    status.textContent = view.message ?? stage + (stats.settled ? '' : toCome);
    const lines = [
      `${size(stats.bytes ?? 0)} received`,
      `link: ${stats.transport ?? 'none'}, ${(rate / 1e6).toFixed(2)} Mbit/s` +
        (stats.rtt_ms ? `, round trip ${stats.rtt_ms.toFixed(0)} ms` : ''),
      `first frame ${seconds(stats.ttff_presented_since_navigation_ms)} after opening the page`,
      `${(stats.faces ?? 0).toLocaleString('en')} faces, error ${stats.max_screen_error_px?.toFixed(1) ?? '–'} px`,
      `quality: ${stats.quality ?? '–'}`,
      // Browsers that keep the device's name to themselves give the interface alone, in brackets.
      stats.adapter?.trim().startsWith('(') ? '' : (stats.adapter ?? ''),
    ];
    figures.textContent = lines.filter(Boolean).join('\n');
  });
}
