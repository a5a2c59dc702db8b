// Time in milliseconds since the page's navigation, on one clock for page and worker: `performance.now()` of a worker
// counts from the worker's start.

let epoch = performance.timeOrigin;

/** The page's epoch, to hand to a worker. */
export const origin = () => epoch;

/** Sets the epoch in a worker. */
export function follow(pageEpoch) {
  epoch = pageEpoch;
}

/** Now, in milliseconds since the navigation. */
export const now = () => performance.timeOrigin - epoch + performance.now();
