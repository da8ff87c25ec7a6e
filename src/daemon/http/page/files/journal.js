// Trips and audit: what the journal keeps, filtered, and to be taken away as a file.

import { add, attribute, fill, h, show, text } from "./dom.js";
import { choices, document_at, labelled, query, table } from "./fetched.js";
import { moment, t, words } from "./texts.js";
import { shown } from "./titles.js";

const HEADINGS = ["time", "what", "drive", "text"].map((word) => t(`heading.${word}`));
const SHOWN = 200;
const EXPORTED = 10_000;
const TABLES = ["all", "trips", "audit", "availability"].map((word) => [word, t(`journal.${word}`)]);
const TIMES = [...["1h", "12h", "24h", "7d"].map((word) => [word, t(`span.${word}`)]), ["", t("journal.whole")]];

/** The panel of the journal. */
export class Journal {
  constructor(element) {
    this.element = element;
    const change = () => this.load();
    const select = (options) => h("select", { change }, ...options.map(([value, label]) => h("option", { value }, label)));
    this.table = select(TABLES);
    this.drive = select([["", t("journal.all")]]);
    this.since = select(TIMES);
    this.since.value = "24h";
    this.csv = h("a", { download: "journal.csv" }, "CSV");
    this.json = h("a", { download: "journal.json" }, "JSON");
    this.used = h("a", { download: "usage.csv", hidden: true }, t("journal.used"));
    this.message = h("p", { class: "message", role: "status" });
    const { element: rows, body, row } = table(t("tab.journal"), HEADINGS);
    this.body = body;
    this.row = row;
    this.is_open = false;
    add(
      element,
      h(
        "div",
        { class: "tools" },
        labelled(t("journal.table"), this.table),
        labelled(t("heading.drive"), this.drive),
        labelled(t("journal.since"), this.since),
        h("button", { type: "button", class: "plain", click: change }, t("journal.refresh")),
        h("span", { class: "export" }, `${t("export")}: `, this.csv, " ", this.json, " ", this.used),
      ),
      this.message,
      h("div", { class: "scroll" }, rows),
    );
  }

  names(drives) {
    choices(this.drive, "drives", drives, t("journal.all"));
  }

  open() {
    this.is_open = true;
    this.load();
  }

  close() {
    this.is_open = false;
  }

  /** Something has happened that may stand in the journal by now. */
  news() {
    if (this.is_open) setTimeout(() => this.load(), 500);
  }

  path(last, format) {
    const chosen = { table: this.table.value, drive: this.drive.value, since: this.since.value };
    return query("api/v1/journal", { ...chosen, last, format });
  }

  async load() {
    const path = this.path(SHOWN, "json");
    attribute(this.csv, "href", this.path(EXPORTED, "csv"));
    attribute(this.json, "href", this.path(EXPORTED, "json"));
    if (!this.body.hasChildNodes()) text(this.message, t("loading"));
    const drive = this.drive.value;
    show(this.used, drive !== "");
    attribute(this.used, "href", query("api/v1/usage", { drive, format: "csv" }));
    const { answer, error } = await document_at(path, this.element);
    if (path !== this.path(SHOWN, "json")) return;
    const rows = answer?.rows ?? [];
    const latest_first = [...rows].sort((one, other) => (one.at < other.at ? 1 : one.at > other.at ? -1 : 0));
    fill(this.body, ...latest_first.map((kept) => this.shown(kept)));
    const count = rows.length === 0 ? t("journal.none") : t(rows.length === SHOWN ? "journal.latest" : "journal.rows", { count: rows.length });
    text(this.message, error ?? count);
  }

  shown({ table: kept_in, at, kind, name, title, text: sentence }) {
    const what = kept_in === "trips" ? "trip" : kept_in;
    const label = kind && kind !== what ? `${words(what)}: ${words(kind)}` : words(what);
    return this.row([moment(at), label, shown(title, name), sentence], kept_in);
  }
}
