// How often a drive tripped for the same reason before, as far as the journal reaches.

const ROWS_MAX = 1000;
const TIMEOUT_MS = 15_000;

let last = Promise.resolve(null);

/** The trips of `drive` with this code before the newest: how many, and when the last one was. Null without a journal, or
 * when it is no longer wanted. One is asked for after the other, whatever trips at once: a stop needs a connection too. */
export function before(drive, code, is_wanted) {
  last = last.then(() => (is_wanted() ? ask(drive, code) : null));
  return last;
}

async function ask(drive, code) {
  const asked = new URLSearchParams({ table: "trips", drive, last: ROWS_MAX });
  try {
    const response = await fetch(`api/v1/journal?${asked}`, { cache: "no-store", signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!response.ok) return null;
    const { rows = [] } = await response.json();
    const same = rows.filter(({ kind, body }) => kind === "tripped" && body?.code === code).map(({ at }) => at).sort();
    return { count: Math.max(0, same.length - 1), last_at: same.at(-2) ?? null };
  } catch {
    return null;
  }
}
