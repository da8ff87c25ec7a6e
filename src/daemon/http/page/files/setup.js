// Set-up: from a port to drives that are read, one step at a time. A step leaves what was typed in the draft.

import { add, fill, h, show, text } from "./dom.js";
import { field, list, numbered, wide } from "./setup_parts.js";
import { Found } from "./setup_found.js";
import { Rules } from "./setup_rules.js";
import { verify } from "./setup_verify.js";
import * as session from "./session.js";
import { t } from "./texts.js";

const EVERY_MS = 1000;
const BAUDS = [1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200];

/** The panel. */
export class Panel {
  constructor(element) {
    this.element = element;
    this.error = h("p", { class: "wrong", role: "alert" });
    this.stage = h("div", { class: "stage" });
    add(element, this.stage, this.error);
    this.draft = { port: null, server: "", stations: "1-32", line: "line-1", scan: null, found: null, rules: new Rules(), drive: null };
    this.site = null;
    this.timer = null;
    this.is_open = false;
  }

  async open() {
    this.is_open = true;
    if (this.step) return this.step.resume?.();
    await this.begin();
  }

  close() {
    this.is_open = false;
    clearTimeout(this.timer);
  }

  /** Where one is: a scan that runs or is done is found again after a reload. */
  async begin() {
    const site = await this.ask("GET", "");
    if (!site) return;
    this.site = site;
    if (site.scan?.state === "running") this.show_scan(site.scan);
    else if (site.scan?.state === "done") this.show_found(site.scan);
    else this.show_port();
  }

  /** Asks the gateway; what went wrong is shown, and then null is returned. */
  async ask(method, path, body = null) {
    text(this.error, "");
    const { answer, error } = await session.set_up(method, path, body);
    if (error !== null) this.fail([error, ...(answer?.problems ?? []).map(problem_text)].join(" "));
    return error === null ? answer : null;
  }

  fail(why) {
    text(this.error, why);
    this.error.scrollIntoView({ block: "nearest" });
  }

  /** Shows a step, and gives it the place of the keyboard. */
  show(title, step, ...content) {
    clearTimeout(this.timer);
    this.step = step;
    text(this.error, "");
    const heading = h("h3", { tabindex: "-1" }, title);
    fill(this.stage, heading, ...content);
    heading.focus({ preventScroll: true });
    heading.scrollIntoView({ block: "nearest" });
  }

  show_port() {
    const { configuration, ports, lines } = this.site;
    const chosen = (value) => () => (this.draft.port = value);
    const server = h("input", { type: "text", placeholder: t("setup.port_example"), autocapitalize: "off", autocomplete: "off", "aria-label": t("setup.port_label") });
    const at_server = h("input", { type: "radio", name: "port", change: chosen(null) });
    server.value = this.draft.server;
    at_server.checked = server.value !== "" && this.draft.port === null;
    server.addEventListener("input", () => {
      at_server.checked = true;
      Object.assign(this.draft, { port: null, server: server.value.trim() });
    });
    const rows = ports.map((port) => port_row(port, this.draft.port === port.port, chosen(port.port)));
    const stations = h("input", { type: "text", value: this.draft.stations, inputmode: "numeric", autocomplete: "off" });
    const known = link_choice();
    const scan = () => {
      const port = at_server.checked ? server.value.trim() : this.draft.port;
      this.draft.stations = stations.value;
      if (!port) return this.fail(t("setup.choose_port"));
      return this.scan({ port, stations: stations.value, ...known.value() });
    };
    const drives = lines.flatMap((line) => line.drives);
    const uncontrolled = drives.filter(({ is_controlled, can_be_commanded }) => !is_controlled && can_be_commanded);
    this.show(
      t("setup.port_title"),
      { resume: () => this.begin() },
      configuration.why_not && h("p", { class: "wrong" }, configuration.why_not),
      rows.length === 0 && h("p", { class: "message" }, t("setup.no_port")),
      h("fieldset", { class: "options" }, h("legend", { class: "unseen" }, t("setup.port")), ...rows,
        h("label", { class: "option" }, at_server, h("span", {}, h("b", {}, t("setup.other_port")), server))),
      field(t("setup.stations"), stations, t("setup.stations_help")),
      known.element,
      h("p", { class: "message" }, t("setup.scan_reads")),
      wide(t("setup.scan"), scan, "primary"),
      uncontrolled.length > 0 && this.offer_control(uncontrolled),
      drives.length > 0 && this.offer_verify(drives),
    );
  }

  /** Control for a drive that is read already. */
  offer_control(drives) {
    const select = h("select", {}, ...drives.map(({ name }) => h("option", { value: name }, name)));
    const give = () => {
      Object.assign(this.draft, { drive: drives.find(({ name }) => name === select.value), rules: new Rules() });
      this.show_rules();
    };
    return h("div", { class: "part" }, field(t("setup.uncontrolled"), select), wide(t("setup.give_control"), give));
  }

  /** Whether drives that are read already obey the bus. */
  offer_verify(drives) {
    const select = h("select", {}, ...drives.map(({ name }) => h("option", { value: name }, name)));
    const look = () => this.show(t("setup.obeys", { drive: select.value }), {}, verify(select.value), wide(t("setup.back"), () => this.begin()));
    return h("div", { class: "part" }, field(t("setup.is_read"), select), wide(t("setup.look"), look));
  }

  async scan(body) {
    const scan = await this.ask("POST", "/scan", body);
    if (scan) this.show_scan(scan);
  }

  show_scan(scan) {
    const bar = h("progress", { max: scan.asks, value: 0, "aria-label": t("setup.asked") });
    const told = h("p", { class: "message", role: "status" });
    const found = h("ul");
    const draw = (now) => {
      bar.value = now.asked;
      const drives = now.drives.length;
      text(told, `${t("drives", { count: drives })}; ${now.at ? t("setup.asking_at", { link: now.at }) : t("setup.listening")}`);
      fill(found, ...now.drives.map((drive) => h("li", {}, h("b", {}, t("setup.station", { station: drive.station })), ` ${guess(drive)}, ${drive.at}`)));
    };
    const look = async () => {
      const { answer, error } = await session.set_up("GET", "/scan");
      if (!this.is_open || this.step !== step) return;
      text(this.error, error ?? "");
      if (answer?.state === "running") draw(answer);
      else if (answer?.state === "done") return this.show_found(answer);
      else if (answer?.state) return this.end_scan(answer.error ?? t("setup.scan_ended"));
      this.timer = setTimeout(look, EVERY_MS);
    };
    const step = { resume: look };
    this.show(t("setup.scanning", { port: scan.port }), step, bar, told, found, wide(t("setup.end_scan"), () => this.end_scan(null)));
    draw(scan);
    this.timer = setTimeout(look, EVERY_MS);
  }

  async end_scan(why) {
    await this.ask("DELETE", "/scan");
    await this.begin();
    if (why !== null) text(this.error, why);
  }

  show_found(scan) {
    this.draft.scan = scan;
    // What was chosen for other drives is not meant for these.
    if (this.draft.found === null || this.draft.drive) Object.assign(this.draft, { drive: null, rules: new Rules() });
    this.draft.found ??= new Found(scan);
    const { found } = this.draft;
    const next = () => {
      const wrong = found.wrong();
      if (wrong !== null) return this.fail(wrong);
      return this.show_rules();
    };
    const again = async () => {
      this.draft.found = null;
      await this.end_scan(null);
    };
    const is_any = found.count() > 0;
    const title = is_any ? t("setup.found", { count: found.count(), link: scan.link }) : t("setup.found_none");
    this.show(title, {}, found.element, is_any && wide(t("setup.continue"), next, "primary"), wide(t("setup.scan_again"), again));
  }

  show_rules() {
    const { rules, found, drive } = this.draft;
    const drives = drive ? [drive] : found.drives();
    const back = () => (drive ? this.begin() : this.show_found(this.draft.scan));
    const check = () => {
      const wrong = rules.wrong();
      if (wrong !== null) return this.fail(wrong);
      return this.check();
    };
    const name = h("input", { type: "text", value: this.draft.line, autocapitalize: "off", autocomplete: "off" });
    name.addEventListener("input", () => (this.draft.line = name.value.trim()));
    rules.offer(this.site, drives, drive !== null);
    const title = drive ? t("setup.who_one", { drive: drive.name }) : t("setup.who_all");
    this.show(title, {}, !drive && field(t("setup.line_name"), name), rules.element, wide(t("setup.check"), check, "primary"), wide(t("setup.back"), back));
  }

  /** What is to be added, as the gateway takes it. */
  wanted() {
    const { rules, found, drive, line } = this.draft;
    if (drive) return { drive: drive.name, control: rules.control(drive) };
    const drives = found.drives().map((of) => ({
      name: of.name, station: of.station, model: of.model, full_scale_hz: of.full_scale_hz, control: rules.control(of),
    }));
    return { line: { name: line }, drives };
  }

  async check() {
    const wanted = this.wanted();
    const proposal = await this.ask("POST", "/proposal", wanted);
    if (!proposal) return;
    const { path } = this.site.configuration;
    const apply = wide(t("setup.apply"), () => this.apply(wanted, proposal.digest), "primary");
    show(apply, proposal.is_right);
    const watched = this.draft.rules.is_controlled ? (wanted.drives ?? []).filter(({ control }) => control === null) : [];
    this.show(
      t(proposal.is_right ? "setup.added" : "setup.not_added"),
      {},
      list(t("setup.problems"), proposal.problems.map(problem_text), "problem"),
      list(t("setup.warnings"), proposal.warnings.map(problem_text), "hint"),
      list(t("setup.only_watched"), watched.map(({ name }) => name), "hint"),
      list(t("setup.costs"), proposal.summary, "good"),
      h("p", { class: "message" }, t("setup.where", { path, line: proposal.line_number })),
      h("pre", { class: "added", tabindex: "0", role: "region", "aria-label": t("setup.text") }, numbered(proposal.text, proposal.line_number)),
      apply,
      wide(t("setup.back"), () => this.show_rules()),
    );
  }

  async apply(wanted, digest) {
    const done = await this.ask("POST", "/apply", { ...wanted, digest });
    if (!done) return;
    const names = wanted.drive ? [wanted.drive] : wanted.drives.map(({ name }) => name);
    const again = async () => {
      Object.assign(this.draft, { found: null, drive: null, port: null, server: "", rules: new Rules() });
      await this.end_scan(null);
    };
    this.show(
      t("setup.done"),
      {},
      list(t("setup.changes"), done.changes, "good"),
      list(t("setup.warnings"), done.warnings.map(problem_text), "hint"),
      h("p", { class: "message" }, t("setup.old_file", { path: done.kept_as })),
      h("p", {}, t("setup.verify_why")),
      ...names.map((name) => verify(name)),
      wide(t("setup.more"), again),
    );
  }
}

function guess({ confidence, models, other }) {
  if (confidence === "asking") return t("guess.asking");
  const titles = models.slice(0, 3).map(({ vendor, title }) => `${vendor} ${title}`);
  return other ? t("guess.says_other", { other }) : titles.join(" / ") || t("guess.unknown");
}

function problem_text({ line, what, right }) {
  return `${line === null ? "" : `${t("problem.line", { line })}: `}${what}${right ? `. ${t("problem.right", { right })}` : ""}`;
}

/** A port with what keeps one from it. */
function port_row({ port, driver, group, may_open, holders, line }, is_chosen, choose) {
  const why = [];
  if (line) why.push(t("port.line", { line }));
  else if (holders.length > 0) why.push(t("port.held", { holders: holders.join(", ") }));
  if (!may_open) why.push(t("port.forbidden", { group }));
  const radio = h("input", { type: "radio", name: "port", change: choose, disabled: why.length > 0, checked: is_chosen && why.length === 0 });
  return h("label", { class: "option" }, radio, h("span", {}, h("b", {}, port), h("small", {}, [driver ?? t("port.no_driver"), ...why].join("; "))));
}

/** For those who know the setting of the line: one is faster than all. */
function link_choice() {
  const option = (value, label = value) => h("option", { value }, String(label));
  const baud = h("select", { "aria-label": t("link.speed") }, option("", t("link.factory")), ...BAUDS.map((it) => option(it, `${it} bit/s`)), option("all", t("link.all")));
  const parity = h("select", { "aria-label": t("link.parity") }, ...["none", "even", "odd"].map((word) => option(word, t(`parity.${word}`))));
  const stop_bits = h("select", { "aria-label": t("link.stop_bits") }, ...[1, 2].map((count) => option(String(count), t("stop_bits", { count }))));
  const more = h("span", { class: "entry" }, parity, stop_bits);
  show(more, false);
  baud.addEventListener("change", () => show(more, Number(baud.value) > 0));
  const value = () => {
    if (baud.value === "all") return { all_settings: true };
    if (baud.value === "") return {};
    return { link: { baud: Number(baud.value), parity: parity.value, stop_bits: Number(stop_bits.value) } };
  };
  return { element: h("div", { class: "part" }, field(t("link.try"), baud), more), value };
}
