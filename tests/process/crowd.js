// Run in the page by many_drives.rs: shows many drives beside the real one, and puts them through all they can be in.

const asset = (name) => import(`/assets/${name}.js`);
const [drives, filter, layout, problems] = await Promise.all(["drives", "filter", "layout", "problems"].map(asset));
const real = drives.all().find(({ name }) => name === "pump-1");
const long = "a sentence that is longer than a card is wide, so that it would take a second row where there is one";

const trip = { active: false, code: null, text: null, count: 0, seen: 0, total: 0, last_at: null };
const tripped = { active: true, code: 9, text: `overvoltage, ${long}`, count: 12, seen: 12, total: 12, last_at: "2026-01-02T03:04:05Z" };
const owner = { owner: `page:${"a".repeat(40)}`, lease_left_ms: 4000, intent: "forward", setpoint_hz: 42.25 };
const no_owner = { owner: null, lease_left_ms: null, intent: "stop", setpoint_hz: null };
const quiet = { start_inhibited: false, command_pending: false, stop_pending: false, not_effective: false, failsafe: null };

/** All that a card shows beside its values, by name. */
const STATES = {
  running: { run_state: "forward", control: { ...owner } },
  "running in reverse": { run_state: "reverse", control: { ...owner, intent: "reverse" } },
  stopping: { run_state: "stopping", control: { command_pending: true } },
  stopped: { run_state: "stopped" },
  inhibited: { run_state: "stopped", control: { start_inhibited: true } },
  pending: { run_state: "forward", control: { ...owner, stop_pending: true, command_pending: true } },
  "not effective": { run_state: "forward", control: { ...owner, not_effective: true, failsafe: { action: "stop", stage: "sent" }, stop_pending: true } },
  tripped: { run_state: "tripped", trip: tripped, control: { start_inhibited: true } },
  "tripped before": { run_state: "stopped", trip: { ...tripped, active: false } },
  warned: { run_state: "forward", warning: long, watchdog: "not_in_order", status: { local: true, alarm: true, ready: false } },
  offline: { run_state: "offline", presence: "offline", output_frequency_hz: null, trip: { ...trip, active: null } },
  "may still run": {
    run_state: "offline", presence: "offline", output_frequency_hz: null, may_still_run: true, trip: { ...trip, active: null },
    last_seen: { run_state: "forward", output_hz: 42.25, at: "2026-01-02T03:04:05Z" },
    control: { stop_pending: true, failsafe: { action: "stop", stage: "due" } },
  },
  unknown: { run_state: "unknown", output_frequency_hz: null, setpoint_hz: null, trip: { ...trip, active: null } },
};

// The gateway does not know them, and so has no trend of them.
const fetched = window.fetch;
window.fetch = (path, ...more) => (String(path).includes("/trend?drive=d-")
  ? Promise.resolve(new Response(JSON.stringify({ columns: [{ name: "output_frequency", unit: "Hz" }], values: [[10, 20, null, 42]] })))
  : fetched(path, ...more));

function in_state(name, state) {
  const { control = {}, ...rest } = STATES[state];
  const values = real.values.map((value) => (state === "offline" ? { ...value, quality: "stale", age_ms: 90_000 } : value));
  const drive = { ...real, name, values, trip, warning: null, watchdog: null, presence: "online", may_still_run: false, ...rest };
  return { ...drive, control: { ...real.control, ...no_owner, ...quiet, ...control } };
}

const names = (many) => Array.from({ length: many }, (_, index) => `d-${index + 1}`);

/** Shows `many` drives beside the real one. */
function crowd(many) {
  const all = [real, ...names(many).map((name, index) => ({
    ...in_state(name, "stopped"),
    line: index % 2 === 0 ? "hall-1" : "hall-2",
    group: index % 3 === 0 ? "water" : null,
    station: index + 2,
  }))];
  drives.replace(all);
  layout.count(all.length);
  filter.parts(all);
  filter.count(drives.all());
  drives.redraw(true);
}

/** Where each stop that can be seen is in the window. */
function stops() {
  const seen = [...document.querySelectorAll(".stop")].filter((stop) => stop.checkVisibility());
  return seen.map((stop) => {
    const { left, top, width, height } = stop.getBoundingClientRect();
    return { label: stop.getAttribute("aria-label") ?? stop.textContent, at: [left, top, width, height].join(" ") };
  });
}

const advice = (many) => names(many).map((drive, index) => ({
  severity: index === 0 ? "problem" : "hint", sign: `sign-${index}`, line: "hall-1", drive, text: `${long} (${index})`,
}));

/** Puts `many` drives through all states, while advice comes and goes; says which stops there are and which moved. */
function moved(many) {
  const before = stops();
  const found = [];
  const compare = (state) => stops().forEach(({ label, at }, index) => {
    if (before[index]?.label !== label || before[index].at !== at) found.push(`${state}: ${label} from ${before[index]?.at} to ${at}`);
  });
  for (const state of Object.keys(STATES)) {
    drives.update(names(many).filter((_, index) => index % 2 === 0).map((name) => in_state(name, state)));
    problems.advise(advice(Object.keys(STATES).indexOf(state) % 7));
    filter.count(drives.all());
    compare(state);
    // How an order ended takes the place of what else is said.
    const shown = [...document.querySelectorAll(".drive .result, .drive .words")];
    shown.forEach((part) => (part.hidden = !part.hidden));
    compare(`${state}, with a result`);
    shown.forEach((part) => (part.hidden = !part.hidden));
  }
  drives.update(names(many).map((name) => in_state(name, "stopped")));
  problems.stopping();
  compare("a stop for all is sent");
  problems.stopped(names(many).map((drive) => ({ drive, outcome: "refused", reason: "drive_offline", message: long })), 700);
  compare("a stop for all is answered");
  problems.advise([]);
  compare("no advice is left");
  return { stops: before.map(({ label }) => label), states: Object.keys(STATES).length, moved: found };
}

window.crowd = { crowd, moved, stops, in_state, drives, problems };
