// The drives that this tab commands: each lease is renewed for as long as the tab is open.

import { announce } from "./dom.js";
import * as session from "./session.js";
import { t } from "./texts.js";
import { called } from "./titles.js";

const STORED = "vfd-gateway.commands";
const EVERY_MS_MIN = 1000;
// After a command the gateway needs a moment to show its owner.
const SETTLE_MS = 4000;

const held = new Map();
const listeners = [];
const ticker = new Worker("assets/ticker.js");

ticker.onmessage = ({ data }) => renew(data);

/** Whether this tab renews the lease of a drive, and every how many milliseconds; null if it does not. */
export function every_ms(drive) {
  return held.get(drive)?.every_ms ?? null;
}

/** Whether the gateway refused the last renewal, because it cannot reach the drive. */
export function is_refused(drive) {
  return held.get(drive)?.is_refused ?? false;
}

/** Calls `listener` with a drive's name when this tab begins or ends to renew its lease. */
export function changed(listener) {
  listeners.push(listener);
}

/** A command of this tab was taken: from now on it shows signs of life. */
export function begin(drive, lost_after_s) {
  hold(drive, lost_after_s);
}

/** Compares what this tab believes with what the gateway shows. */
export function observe({ name, control }) {
  const owner = control?.owner ?? null;
  const is_ours = owner !== null && owner === own_name();
  const lease = held.get(name);
  if (!lease) {
    // A tab that was reloaded goes on with what it commanded before.
    if (is_ours && stored().includes(name)) hold(name, control.lost_after_s);
  } else if (is_ours) {
    lease.is_shown = true;
  } else if (lease.is_shown || performance.now() - lease.since > SETTLE_MS) {
    end(name, owner);
  }
}

/** The gateway's name for the signed-in user; null without one. */
function own_name() {
  const { user } = session.current();
  return user === null ? null : `page ${user}`;
}

/** The user has signed out. */
export function end_all() {
  for (const drive of [...held.keys()]) drop(drive);
}

function hold(drive, lost_after_s) {
  const every_ms = Math.max(EVERY_MS_MIN, (lost_after_s * 1000) / 3);
  held.set(drive, { every_ms, is_shown: false, since: performance.now(), is_busy: false, is_refused: false });
  ticker.postMessage({ name: drive, every_ms });
  store();
  listeners.forEach((listener) => listener(drive));
}

async function renew(drive) {
  const lease = held.get(drive);
  // Until the gateway shows it there is nothing to renew: a setpoint for a drive that stands still begins no lease.
  if (!lease || lease.is_busy || !lease.is_shown) return;
  lease.is_busy = true;
  const { may_renew, is_renewed } = await session.renew(drive, lease.every_ms);
  lease.is_busy = false;
  lease.is_refused = !is_renewed;
  if (!may_renew && held.get(drive) === lease) end(drive, null);
}

function end(drive, owner) {
  const was_shown = held.get(drive)?.is_shown;
  drop(drive);
  const named = { drive: called("drives", drive), owner };
  if (was_shown && owner !== null) announce(t("lease.taken", named), true);
  else if (was_shown) announce(t("lease.ended", named));
}

function drop(drive) {
  held.delete(drive);
  ticker.postMessage({ name: drive, every_ms: 0 });
  store();
  listeners.forEach((listener) => listener(drive));
}

function store() {
  try {
    sessionStorage.setItem(STORED, JSON.stringify([...held.keys()]));
  } catch {
    // Without a store a page that is reloaded has to take control again.
  }
}

function stored() {
  try {
    const names = JSON.parse(sessionStorage.getItem(STORED) ?? "[]");
    return Array.isArray(names) ? names : [];
  } catch {
    return [];
  }
}
