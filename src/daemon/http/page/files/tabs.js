// Panels of which one is shown, chosen by a row of tabs.

import { add, h, show } from "./dom.js";

/** Shows one of `panels`, each with an id, a label and what is told when it opens and closes. */
export class Tabs {
  constructor(list, panels) {
    this.panels = panels;
    this.list = list;
    this.chosen = null;
    for (const panel of panels) {
      panel.tab = h(
        "button",
        {
          type: "button",
          role: "tab",
          id: `tab-${panel.id}`,
          "aria-controls": panel.id,
          click: () => this.take(panel),
          keydown: (event) => this.key(event),
        },
        panel.label,
      );
      panel.element.setAttribute("aria-labelledby", panel.tab.id);
      panel.element.addEventListener("missing", () => this.leave_out(panel));
      add(list, panel.tab);
    }
    this.draw();
  }

  /** Opens what was chosen last, or the first. */
  begin() {
    if (this.chosen) return;
    const wanted = location.hash.slice(1);
    this.choose(this.panels.find((panel) => panel.id === wanted && !panel.tab.hidden) ?? this.panels[0]);
  }

  /** Whether the address names one of them. */
  is_named() {
    return this.panels.some(({ id }) => location.hash === `#${id}`);
  }

  choose(panel) {
    if (this.chosen === panel) return;
    this.chosen?.part.close();
    this.chosen = panel;
    this.draw();
    panel.part.open();
  }

  /** A person has chosen it. */
  take(panel) {
    this.choose(panel);
    history.replaceState(null, "", `#${panel.id}`);
  }

  /** This gateway does not serve what the panel shows. */
  leave_out(panel) {
    this.panels = this.panels.filter((other) => other !== panel);
    panel.tab.remove();
    show(panel.element, false);
    if (this.chosen === panel && this.panels.length > 0) this.choose(this.panels[0]);
  }

  /** Whether a panel can be chosen at all. */
  offer(id, is) {
    const panel = this.panels.find((other) => other.id === id);
    if (!panel || panel.tab.hidden === !is) return;
    show(panel.tab, is);
    if (is && location.hash === `#${id}` && this.chosen) this.choose(panel);
    if (!is && this.chosen === panel) this.choose(this.panels[0]);
  }

  draw() {
    for (const panel of this.panels) {
      const is = panel === this.chosen;
      panel.tab.setAttribute("aria-selected", String(is));
      panel.tab.tabIndex = is || (!this.chosen && panel === this.panels[0]) ? 0 : -1;
      show(panel.element, is);
    }
  }

  key(event) {
    const panels = this.panels.filter(({ tab }) => !tab.hidden);
    const at = panels.indexOf(this.chosen);
    const last = panels.length - 1;
    const to = { ArrowRight: at === last ? 0 : at + 1, ArrowLeft: at === 0 ? last : at - 1, Home: 0, End: last }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.take(panels[to]);
    panels[to].tab.focus();
  }
}
