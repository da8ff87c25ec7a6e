// Who is signed in, and everything that is sent to the gateway.

import { announce } from "./dom.js";
import { sentence_of, t, words } from "./texts.js";

const TIMEOUT_MS = 20_000;
const STOP_TIMEOUT_MS = 8000;
const LONG_TIMEOUT_MS = 40_000;
// The gateway takes a moment for 1.5 s. Where no events bring one, as in a hidden tab, a renewal asks for one first.
const FRESH_MS = 700;

const session = { is_known: false, enabled: false, is_private: false, user: null, role: null, groups: null, setup: false, token: null };
const listeners = [];
// The newest moment from the gateway. An order names the one that was newest when it was given: what waits on its way is old.
let moment = null;
let seen_at = -Infinity;

/** What is known of the session. */
export function current() {
  return session;
}

/** Whether the user may command a drive of this group. */
export function may_command(group) {
  const { groups } = session;
  return may_stop() && (groups === null || groups.includes(group));
}

/** Whether the user may stop drives: all of them, whatever their groups. */
export function may_stop() {
  return session.user !== null && session.role !== "view";
}

/** Whether the user may do what concerns the gateway as a whole. */
export function may_maintain() {
  return session.role === "maintain" || session.role === "setup";
}

/** Whether one has to sign in to see the drives. */
export function is_closed() {
  return session.is_private && session.user === null;
}

/** Calls `listener` whenever a user signs in or out. */
export function changed(listener) {
  listeners.push(listener);
}

function take(next) {
  Object.assign(session, next);
  listeners.forEach((listener) => listener(session));
}

/** The gateway has handed out a moment. */
export function see(next) {
  if (!next) return;
  moment = next;
  seen_at = performance.now();
}

async function ask(timeout_ms) {
  const begun = performance.now();
  const response = await fetch("api/v1/session", { cache: "no-store", signal: AbortSignal.timeout(timeout_ms) });
  const answer = response.ok ? await response.json() : {};
  // An event may have brought a newer one meanwhile.
  if (seen_at < begun) see(answer.moment);
  return answer;
}

function rights_in({ role = null, groups = null, setup = false, token = null }) {
  return { role, groups, setup, token };
}

/** Asks the gateway who is signed in. Where it knows of no sessions, control is off. */
export async function refresh() {
  try {
    const { enabled = false, private: is_private = false, user = null, ...rights } = await ask(TIMEOUT_MS);
    take({ is_known: true, enabled, is_private, user, ...rights_in(rights) });
  } catch {
    // It is asked again when the gateway is back.
  }
}

/** Signs in; returns what went wrong, or null. */
export async function sign_in(user, password) {
  const { status, answer } = await send("POST", "api/v1/session", { user, password }, TIMEOUT_MS);
  if (status === 200) {
    see(answer.moment);
    take({ is_known: true, enabled: true, user: answer.user ?? user, ...rights_in(answer) });
    announce(t("sign.done", { user: session.user }));
    return null;
  }
  return (status === 401 ? t("sign.wrong") : answer?.error) ?? unanswered(status);
}

/** Signs out. */
export async function sign_out() {
  await send("DELETE", "api/v1/session", null, TIMEOUT_MS);
  // What is shown is for users only.
  if (session.is_private) location.reload();
  take({ user: null, ...rights_in({}) });
  await refresh();
}

/** Saves the gateway's diagnostics as a file; returns what went wrong, or null. */
export async function diagnostics() {
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": session.token ?? "" };
  try {
    const signal = AbortSignal.timeout(LONG_TIMEOUT_MS);
    const response = await fetch("api/v1/diagnostics", { method: "POST", headers, body: "{}", cache: "no-store", signal });
    if (!response.ok) {
      const answer = await response.json().catch(() => null);
      return answer?.error ?? unanswered(response.status);
    }
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await response.blob());
    link.download = /filename="([^"]+)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "diagnostics.tar.gz";
    link.click();
    URL.revokeObjectURL(link.href);
    return null;
  } catch {
    return unanswered(0);
  }
}

/** What is said where an answer has no sentence of its own. */
function unanswered(status) {
  return status === 0 ? t("gateway.no_answer") : t("gateway.answered", { status });
}

async function send(method, path, body, timeout_ms, named = null) {
  const headers = { "Content-Type": "application/json" };
  if (session.token) headers["X-CSRF-Token"] = session.token;
  if (named) headers["Vfd-Moment"] = named;
  try {
    const response = await fetch(path, {
      method,
      headers,
      body: body === null ? undefined : JSON.stringify(body),
      cache: "no-store",
      signal: AbortSignal.timeout(timeout_ms),
    });
    const answer = await response.json().catch(() => null);
    return { status: response.status, answer, is_late: false };
  } catch (error) {
    return { status: 0, answer: null, is_late: error.name === "TimeoutError" };
  }
}

/** Sends with the session's token; once more with a new one if the old one is no longer taken. */
async function send_signed(path, body, timeout_ms) {
  // An order is as old as the click, however long it takes to get a new token.
  const named = moment;
  const first = await send("POST", path, body, timeout_ms, named);
  if (first.status !== 401 && first.status !== 403) return first;
  const before = session.token;
  await refresh();
  if (session.user === null || session.token === before) return first;
  return send("POST", path, body, timeout_ms, named);
}

/** Commands a drive. Always returns an outcome with a sentence. */
export async function command(drive, body) {
  const is_stop = body.run === "stop" || body.run === "coast";
  const path = `api/v1/drives/${encodeURIComponent(drive)}/command`;
  const reply = await send_signed(path, body, is_stop ? STOP_TIMEOUT_MS : TIMEOUT_MS);
  return judged(reply, is_stop);
}

/** Says that the motor of a drive that is out of sight stands. Always returns an outcome with a sentence. */
export async function standstill(drive) {
  return judged(await send_signed(`api/v1/drives/${encodeURIComponent(drive)}/standstill`, {}, TIMEOUT_MS), false);
}

function judged({ status, answer, is_late }, is_stop) {
  if (status === 0) {
    const of_stop = is_late ? "stop.no_effect" : "stop.no_gateway";
    return { outcome: "unknown", message: t(is_stop ? of_stop : "command.no_answer") };
  }
  if (answer?.outcome) return answer;
  if (status === 401) return { outcome: "refused", message: t("sign.lost") };
  return { outcome: "refused", message: answer?.error ?? answer?.message ?? unanswered(status) };
}

/** How a command ended, in words. */
export function outcome_text({ outcome, reason, message, said }) {
  const why = reason === "none" ? "" : sentence_of({ said, text: message ?? words(reason) });
  return `${words(outcome)}${why ? `: ${why}` : ""}`;
}

/** Stops every drive that may be controlled from here. */
export async function stop_all() {
  const reply = await send_signed("api/v1/stop", {}, STOP_TIMEOUT_MS);
  if (Array.isArray(reply.answer?.drives)) return reply.answer.drives;
  const { outcome, message } = judged(reply, true);
  return [{ drive: t("drives.all"), outcome, message }];
}

/** Gives a line to the other gateway. Always returns an outcome with a sentence. */
export async function hand_over(line) {
  const reply = await send_signed("api/v1/standby/yield", { line }, LONG_TIMEOUT_MS);
  return reply.answer?.lines?.[0] ?? judged(reply, false);
}

/** Asks something of set-up; returns the answer, or what went wrong. */
export async function set_up(method, path, body = null) {
  const is_order = method !== "GET";
  try {
    if (is_order && performance.now() - seen_at > FRESH_MS) await ask(TIMEOUT_MS / 2);
  } catch {
    // What is sent now is refused, or lost as well.
  }
  const { status, answer } = await send(method, `api/v1/setup${path}`, body, TIMEOUT_MS, is_order ? moment : null);
  const is_unknown = status === 0 && is_order;
  if (status >= 200 && status < 300) return { answer: answer ?? {}, error: null, is_unknown };
  if (status === 0) return { answer: null, error: unanswered(0), is_unknown };
  if (status === 401) {
    await refresh();
    return { answer: null, error: t("sign.lost_in_setup"), is_unknown };
  }
  return { answer, error: answer?.error ?? unanswered(status), is_unknown };
}

/** Renews the lease of a drive. Returns whether it is renewed, and whether we may still do so; who holds control is told by
 * the events. */
export async function renew(drive, timeout_ms) {
  const path = `api/v1/drives/${encodeURIComponent(drive)}/lease`;
  try {
    if (performance.now() - seen_at > FRESH_MS) await ask(timeout_ms / 2);
  } catch {
    // What is sent now is refused, or lost as well.
  }
  const { status } = await send("POST", path, {}, timeout_ms, moment);
  return { is_renewed: status >= 200 && status < 300, may_renew: status !== 401 && status !== 403 && status !== 404 };
}
