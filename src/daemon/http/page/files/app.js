// The page: what the gateway tells goes to its parts.

import { announce, attribute, fill, h, show, text } from "./dom.js";
import * as drives from "./drives.js";
import * as filter from "./filter.js";
import * as footer from "./footer.js";
import { Journal } from "./journal.js";
import * as layout from "./layout.js";
import * as lines from "./lines.js";
import * as notify from "./notify.js";
import * as problems from "./problems.js";
import * as session from "./session.js";
import * as signing from "./signing.js";
import { Stream } from "./stream.js";
import { Tabs } from "./tabs.js";
import { clock, number, t, translate, words } from "./texts.js";
import * as titles from "./titles.js";

const at = (id) => document.getElementById(id);

/** A panel that few use: its files are fetched when it is opened. */
function lazy(path, element) {
  let panel = null;
  let known = [];
  return {
    names: async (names) => {
      known = names;
      (await panel)?.names(names);
    },
    open: async () => {
      try {
        if (panel === null) text(element, t("loading"));
        panel ??= import(path).then(({ Panel }) => new Panel(fill(element)));
        (await panel).names?.(known);
        (await panel).open();
      } catch {
        panel = null;
        text(element, t("panel.not_loaded"));
      }
    },
    close: async () => (await panel)?.close(),
  };
}

let version = null;
let names = { drives: [], lines: [] };

const trend = lazy("./trend.js", at("trend"));
const journal = new Journal(at("journal"));
const traffic = lazy("./traffic.js", at("traffic"));
const report = lazy("./report.js", at("report"));
const tabs = new Tabs(at("tabs"), [
  { id: "trend", label: t("tab.trend"), element: at("trend"), part: trend },
  { id: "journal", label: t("tab.journal"), element: at("journal"), part: journal },
  { id: "traffic", label: t("tab.traffic"), element: at("traffic"), part: traffic },
  { id: "report", label: t("tab.report"), element: at("report"), part: report },
  { id: "setup", label: t("tab.setup"), element: at("setup"), part: lazy("./setup.js", at("setup")) },
]);
tabs.offer("setup", false);
// What they show is fetched when it comes into sight, behind the drives.
const panels = new IntersectionObserver((entries) => entries.some(({ isIntersecting }) => isIntersecting) && tabs.begin());

translate(document);
footer.start(at("language"));
drives.start(at("drives"));
filter.start(at("filter"), at("counts"), at("no-hit"));
layout.start(at("layout"), at("drives"));
lines.start(at("lines"));
notify.start(at("notify"));
problems.start(at("advice"), at("advice-title"));
signing.start(at("session"), at("sign-in-place"));
session.refresh();

function take_gateway(gateway) {
  if (!gateway) return;
  // Another program serves another page.
  if (version !== null && version !== gateway.version) location.reload();
  version = gateway.version;
  text(at("gateway"), titles.gateway(gateway.name));
  text(at("version"), t("gateway.version", { version: gateway.version }));
  const { mqtt, journal: kept, ready } = gateway;
  const states = [
    [ready === false, t("gateway.not_ready")],
    [mqtt?.connected === false, t("gateway.no_broker")],
    [mqtt?.contested, t("gateway.contested")],
    [kept?.reason, t("gateway.journal", { reason: words(kept?.reason) })],
  ];
  fill(at("states"), ...states.filter(([is]) => is).map(([, label]) => h("li", {}, label)));
}

function take_names(told) {
  names = { drives: told.drives.map(({ name }) => name), lines: told.lines.map(({ name }) => name) };
  trend.names(names.drives);
  journal.names(names.drives);
  traffic.names(names.lines);
  report.names(names.lines);
}

/** The tab tells the worst state, also while another one is looked at. */
function take_advice(advice) {
  const many = problems.advise(advice);
  const name = `${at("gateway").textContent} · VFD gateway`;
  document.title = many === 0 ? name : `(${number(many)}!) ${name}`;
  attribute(at("icon"), "href", many === 0 ? "assets/icon.svg" : "assets/icon-problem.svg");
}

/** What is said of all drives together. */
function count() {
  filter.count(drives.all());
  document.body.classList.toggle("all-stand", drives.all_stand());
}

const on = {
  state(document) {
    titles.take(document.titles);
    take_gateway(document.gateway);
    take_names(document);
    lines.replace(document.lines);
    drives.replace(document.drives);
    layout.count(document.drives.length);
    show(at("none"), document.drives.length === 0);
    filter.parts(document.drives);
    drives.redraw(true);
    take_advice(document.advice ?? []);
    count();
    show(at("waiting"), false);
    if (tabs.is_named()) tabs.begin();
    else panels.observe(at("tabs"));
  },

  update(document) {
    take_gateway(document.gateway);
    if (document.lines) lines.update(document.lines);
    if (document.oldest_ms) drives.oldest(document.oldest_ms);
    if (document.drives) drives.update(document.drives);
    if (document.advice) take_advice(document.advice);
    count();
  },

  trip({ drive: tripped, kind, code, text: sentence }) {
    const drive = titles.called("drives", tripped);
    const name = [code, sentence].filter((part) => part !== null && part !== undefined && part !== "").join(" ");
    announce(kind === "cleared" ? t("trip.cleared", { drive }) : t("trip.announced", { drive, trip: name }), kind !== "cleared");
    journal.news();
  },

  alive({ moment }) {
    session.see(moment);
  },

  configuration() {
    announce(t("gateway.reloaded"));
  },

  connection(state, heard_at) {
    // Nothing is lost where nothing is shown yet.
    text(at("waiting"), t(session.is_closed() ? "waiting.sign_in" : "waiting.gateway"));
    const is_lost = state === "lost" && !session.is_closed();
    const was_lost = document.body.dataset.connection === "lost";
    attribute(document.body, "data-connection", state);
    drives.redraw(state === "live");
    count();
    const word = state === "live" ? "live" : is_lost ? "lost" : "connecting";
    const at_least = heard_at === null ? "" : "_since";
    const since = { since: heard_at === null ? "" : clock(heard_at) };
    text(at("connection"), word === "lost" ? t(`connection.lost${at_least}`, since) : t(`connection.${word}`));
    show(at("lost"), is_lost);
    text(at("lost-text"), t(`contact.lost${at_least}`, since));
    if (is_lost) announce(t(`contact.announced${at_least}`, since), true);
    if (state === "live" && was_lost) announce(t("contact.back"));
    if (state === "live") session.refresh();
  },
};

// For the installed app alone, which starts below `open/`. It never stands between this page and the gateway: a stop must not
// wait for it.
navigator.serviceWorker?.register("offline.js", { scope: "open/" }).catch(() => {});

const stream = new Stream(on);
session.changed(({ setup }) => {
  tabs.offer("setup", setup);
  drives.redraw();
  stream.again();
});
