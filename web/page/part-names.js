// Lookups of parts: promises for what the worker answers.

/** Lookups that wait for the worker's answers. */
export class PartLookups {
  #waiting = new Map();
  #next = 0;

  /** Asks a worker what a part is called. Rejects if that is not known. */
  ask(worker, instance, part) {
    const valid = (number) => Number.isInteger(number) && number >= 0 && number < 2 ** 32;
    if (!valid(instance) || !valid(part)) {
      return Promise.reject(new TypeError(`instance ${instance}, part ${part}: both must be whole numbers from 0 to 2^32 - 1`));
    }
    if (!worker) return Promise.reject(new Error('the session has ended'));
    return new Promise((resolve, reject) => {
      const number = this.#next;
      this.#next += 1;
      this.#waiting.set(number, { instance, part, resolve, reject });
      worker.postMessage({ kind: 'part', instance, part });
    });
  }

  /** Takes answers of the worker: equal lookups have equal answers. */
  answer(answers) {
    for (const { instance, part, info, absence } of answers) {
      for (const [number, lookup] of this.#waiting) {
        if (lookup.instance !== instance || lookup.part !== part) continue;
        this.#waiting.delete(number);
        if (info) settle(lookup, info);
        else lookup.reject(new Error(absence));
        break;
      }
    }
  }

  /** Ends all lookups. */
  end(why) {
    for (const { reject } of this.#waiting.values()) reject(new Error(why));
    this.#waiting.clear();
  }
}

/** Extras come as JSON text, which the server may not have checked. */
function settle({ resolve, reject }, { name, path, extras }) {
  try {
    resolve({ name, path, extras: extras === undefined ? null : JSON.parse(extras) });
  } catch (why) {
    reject(new Error(`the part's extras are no JSON: ${why.message}`));
  }
}
