// Trips and audit: what the journal keeps, filtered, and to be taken away as a file.

import { attribute, h, moment, text, words } from "./dom.js";
import { choices, document_at, labelled, query, table } from "./fetched.js";

const HEADINGS = ["Time", "What", "Drive", "Text"];
const SHOWN = 200;
const EXPORTED = 10_000;
const TABLES = [["all", "All"], ["trips", "Trips"], ["audit", "Audit"], ["availability", "Availability"]];
const TIMES = [["1h", "1 hour"], ["12h", "12 hours"], ["24h", "24 hours"], ["7d", "7 days"], ["", "All that is kept"]];

/** The panel of the journal. */
export class Journal {
  constructor(element) {
    this.element = element;
    const change = () => this.load();
    const select = (options) => h("select", { change }, ...options.map(([value, label]) => h("option", { value }, label)));
    this.table = select(TABLES);
    this.drive = select([["", "All"]]);
    this.since = select(TIMES);
    this.since.value = "24h";
    this.csv = h("a", { download: "journal.csv" }, "CSV");
    this.json = h("a", { download: "journal.json" }, "JSON");
    this.message = h("p", { class: "message", role: "status" });
    const { element: shown, body, row } = table("Trips and audit", HEADINGS);
    this.body = body;
    this.row = row;
    this.is_open = false;
    element.append(
      h(
        "div",
        { class: "tools" },
        labelled("Table", this.table),
        labelled("Drive", this.drive),
        labelled("Since", this.since),
        h("button", { type: "button", class: "plain", click: change }, "Refresh"),
        h("span", { class: "export" }, "Export: ", this.csv, " ", this.json),
      ),
      this.message,
      h("div", { class: "scroll" }, shown),
    );
  }

  names(drives) {
    choices(this.drive, drives, "All");
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
    const { answer, error } = await document_at(path, this.element);
    if (path !== this.path(SHOWN, "json")) return;
    const rows = answer?.rows ?? [];
    const latest_first = [...rows].sort((one, other) => (one.at < other.at ? 1 : one.at > other.at ? -1 : 0));
    this.body.replaceChildren(...latest_first.map((kept) => this.shown(kept)));
    const count = rows.length === SHOWN ? `The latest ${SHOWN} rows.` : rows.length === 0 ? "No rows." : `${rows.length} rows.`;
    text(this.message, error ?? count);
  }

  shown({ table: kept_in, at, kind, name, text: sentence }) {
    const what = kept_in === "trips" ? "trip" : kept_in;
    const label = kind && kind !== what ? `${words(what)}: ${words(kind)}` : words(what);
    return this.row([moment(at), label, name, sentence], kept_in);
  }
}
