// What this browser keeps for the page. One that keeps nothing shows the page all the same.

const memory = new Map();

/** What was kept under `key`; null if nothing. */
export function kept(key) {
  try {
    return memory.get(key) ?? localStorage.getItem(key);
  } catch {
    return null;
  }
}

/** Keeps `value` under `key`; where the browser refuses, until the page is loaded again. */
export function keep(key, value) {
  memory.set(key, value);
  try {
    localStorage.setItem(key, value);
  } catch {
    // It is in memory.
  }
}
