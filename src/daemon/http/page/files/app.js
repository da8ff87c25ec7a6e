// The page: what the gateway tells goes to its parts.

import { announce, attribute, clock, h, number, show, text, words } from "./dom.js";
import * as drives from "./drives.js";
import { Journal } from "./journal.js";
import * as lines from "./lines.js";
import { Report } from "./report.js";
import * as session from "./session.js";
import * as signing from "./signing.js";
import { Stream } from "./stream.js";
import { Tabs } from "./tabs.js";
import { Traffic } from "./traffic.js";
import { Trend } from "./trend.js";

const at = (id) => document.getElementById(id);
const COUNTED = ["tripped", "offline", "unknown", "running", "stopped"];
const MOVING = new Set(["forward", "reverse", "running", "stopping"]);

let version = null;
let names = { drives: [], lines: [] };

const trend = new Trend(at("trend"));
const journal = new Journal(at("journal"));
const traffic = new Traffic(at("traffic"));
const report = new Report(at("report"));
const tabs = new Tabs(at("tabs"), [
  { id: "trend", label: "Trend", element: at("trend"), part: trend },
  { id: "journal", label: "Trips and audit", element: at("journal"), part: journal },
  { id: "traffic", label: "Traffic", element: at("traffic"), part: traffic },
  { id: "report", label: "Line report", element: at("report"), part: report },
]);

drives.start(at("drives"));
lines.start(at("lines"), at("advice"));
signing.start(at("session"), at("sign-in-place"), at("stop-results"));
session.changed(() => drives.redraw());
session.refresh();

function take_gateway(gateway) {
  if (!gateway) return;
  // Another program serves another page.
  if (version !== null && version !== gateway.version) location.reload();
  version = gateway.version;
  document.title = `${gateway.name} · VFD gateway`;
  text(at("gateway"), gateway.name);
  text(at("version"), `version ${gateway.version}`);
  const { mqtt, journal: kept, ready } = gateway;
  const states = [
    [ready === false, "Not ready"],
    [mqtt?.connected === false, "MQTT broker not reached"],
    [mqtt?.contested, "MQTT identifier is contested"],
    [kept?.reason, `Journal: ${words(kept?.reason)}`],
  ];
  at("states").replaceChildren(...states.filter(([is]) => is).map(([, label]) => h("li", {}, label)));
}

function take_names(told) {
  names = { drives: told.drives.map(({ name }) => name), lines: told.lines.map(({ name }) => name) };
  trend.names(names.drives);
  journal.names(names.drives);
  traffic.names(names.lines);
  report.names(names.lines);
}

function count() {
  const counts = new Map(COUNTED.map((word) => [word, 0]));
  for (const { run_state } of drives.all()) {
    const word = MOVING.has(run_state) ? "running" : run_state;
    counts.set(word, (counts.get(word) ?? 0) + 1);
  }
  const shown = [...counts].filter(([, many]) => many > 0);
  const wanted = shown.map(([word, many]) => `${many} ${words(word)}`).join(", ");
  if (at("counts").dataset.shown === wanted) return;
  at("counts").dataset.shown = wanted;
  at("counts").replaceChildren(...shown.map(([word, many]) => h("li", { "data-state": word }, h("b", {}, number(many)), ` ${words(word)}`)));
}

const on = {
  state(document) {
    take_gateway(document.gateway);
    take_names(document);
    lines.replace(document.lines);
    drives.replace(document.drives);
    drives.redraw(true);
    lines.advise(document.advice ?? []);
    count();
    show(at("waiting"), false);
    tabs.begin();
  },

  update(document) {
    take_gateway(document.gateway);
    if (document.lines) lines.update(document.lines);
    if (document.drives) drives.update(document.drives);
    if (document.advice) lines.advise(document.advice);
    count();
  },

  trip({ drive, kind, code, text: sentence }) {
    const name = [code, sentence].filter((part) => part !== null && part !== undefined && part !== "").join(" ");
    announce(kind === "cleared" ? `${drive}: trip cleared` : `${drive} tripped: ${name}`, kind !== "cleared");
    journal.news();
  },

  alive({ moment }) {
    session.see(moment);
  },

  configuration() {
    announce("The gateway has a new configuration");
  },

  connection(state, heard_at) {
    const is_lost = state === "lost";
    const was_lost = document.body.dataset.connection === "lost";
    attribute(document.body, "data-connection", state);
    drives.redraw(state === "live");
    const since = heard_at === null ? "" : ` since ${clock(heard_at)}`;
    text(at("connection"), state === "live" ? "Live" : is_lost ? `Lost${since}` : "Connecting");
    show(at("lost"), is_lost);
    const old = heard_at === null ? "" : " What is shown below is old.";
    text(at("lost-text"), `No contact with the gateway${since}.${old} Trying again.`);
    if (is_lost) announce(`No contact with the gateway${since}`, true);
    if (state === "live" && was_lost) announce("The gateway is back");
    if (state === "live") session.refresh();
  },
};

new Stream(on);
