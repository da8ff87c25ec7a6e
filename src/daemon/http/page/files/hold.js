// A button that is not hit by accident: it is held, or pressed twice with a pause between.

import { h, text } from "./dom.js";
import { t } from "./texts.js";

const HOLD_MS = 600;
const ARMED_MS = 5000;

/** A button for `act`. Its label may change while it is not pressed. */
export class Hold {
  constructor(label, kind, act) {
    this.label = label;
    this.act = act;
    this.timer = null;
    this.armed_at = null;
    this.face = h("span", { class: "face" }, label);
    const press = (event) => event.button === 0 && this.press();
    this.element = h(
      "button",
      {
        type: "button",
        class: `hold ${kind}`,
        title: t("hold.how", { seconds: HOLD_MS / 1000 }),
        pointerdown: press,
        pointerup: () => this.release(),
        pointerleave: () => this.cancel(),
        pointercancel: () => this.cancel(),
        contextmenu: (event) => event.preventDefault(),
        keydown: (event) => this.key(event, () => event.repeat || this.press()),
        keyup: (event) => this.key(event, () => this.release()),
        click: (event) => this.click(event),
        blur: () => this.cancel(),
      },
      h("span", { class: "fill" }),
      this.face,
    );
  }

  key(event, then) {
    if (event.key !== "Enter" && event.key !== " ") return;
    // Otherwise the key would click as well.
    event.preventDefault();
    then();
  }

  /** Programs that help to use a page click without a pointer or a key: such a click arms, and the next one acts. */
  click(event) {
    if (event.detail === 0) {
      this.press();
      this.release();
    }
  }

  get is_off() {
    return this.element.getAttribute("aria-disabled") === "true";
  }

  press() {
    if (this.is_off || this.timer !== null) return;
    const armed_for = this.armed_at === null ? 0 : performance.now() - this.armed_at;
    if (armed_for >= HOLD_MS) {
      this.fire();
      return;
    }
    this.element.classList.add("pressed");
    this.timer = setTimeout(() => this.fire(), HOLD_MS);
  }

  release() {
    if (this.timer === null) return;
    this.cancel();
    this.armed_at = performance.now();
    this.element.classList.add("armed");
    text(this.face, t("hold.again", { label: this.label }));
    const armed_at = this.armed_at;
    setTimeout(() => this.armed_at === armed_at && this.disarm(), ARMED_MS);
  }

  cancel() {
    clearTimeout(this.timer);
    this.timer = null;
    this.element.classList.remove("pressed");
  }

  disarm() {
    this.armed_at = null;
    this.element.classList.remove("armed");
    text(this.face, this.label);
  }

  fire() {
    this.cancel();
    this.disarm();
    if (!this.is_off) this.act();
  }

  /** Renames it. What was begun under another name was meant otherwise, so it is dropped. */
  rename(label) {
    if (label === this.label) return;
    this.cancel();
    this.label = label;
    this.disarm();
  }

  /** Switches it on or off. It keeps the keyboard's place. */
  enable(is) {
    this.element.setAttribute("aria-disabled", is ? "false" : "true");
    if (!is) {
      this.cancel();
      this.disarm();
    }
  }
}
