// Small helpers to build and change what is shown. Text is only ever set as text.

const SVG = "http://www.w3.org/2000/svg";

/** Makes a part of a drawing. */
export function svg(name, attributes, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return add(element, ...children);
}

/** Makes an element. `attributes` that are functions listen to the event of that name; false and null leave one out. */
export function h(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(key, value);
    else if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(key, value === true ? "" : String(value));
    }
  }
  return add(element, ...children);
}

/** Adds children. Parts that are not there (null, undefined, false) are left out, here and nowhere else. */
export function add(element, ...children) {
  element.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Puts these children in place of all others. */
export function fill(element, ...children) {
  element.replaceChildren();
  return add(element, ...children);
}

/** Sets the text of an element if it is another one. */
export function text(element, value) {
  const wanted = value === null || value === undefined ? "" : String(value);
  if (element.textContent !== wanted) element.textContent = wanted;
}

/** A sentence in which commands and keys stand between backticks, as elements. */
export function prose(sentence) {
  return String(sentence).split("`").map((part, index) => (index % 2 === 1 ? h("code", {}, part) : part));
}

/** Shows or hides an element. */
export function show(element, is) {
  if (element.hidden === Boolean(is)) element.hidden = !is;
}

/** Sets an attribute if it is another one; null removes it. */
export function attribute(element, key, value) {
  if (value === null) element.removeAttribute(key);
  else if (element.getAttribute(key) !== String(value)) element.setAttribute(key, String(value));
}

/** Brings the children of `parent` in line with `items`: one child each, in this order, kept by its key. */
export function keyed(parent, known, items, key, make) {
  const wanted = new Set(items.map(key));
  for (const [name, part] of known) {
    if (!wanted.has(name)) {
      part.element.remove();
      known.delete(name);
    }
  }
  let before = null;
  for (const item of items) {
    const name = key(item);
    if (!known.has(name)) known.set(name, make(item));
    const { element } = known.get(name);
    const place = before ? before.nextSibling : parent.firstChild;
    if (place !== element) parent.insertBefore(element, place);
    before = element;
  }
}

/** Whether two documents say the same. */
export function same(one, other) {
  return JSON.stringify(one) === JSON.stringify(other);
}

// Shapes of 20 by 20, so that no state is told by its colour alone.
const SHAPES = {
  forward: "M5 3 L17 10 L5 17 Z",
  reverse: "M15 3 L3 10 L15 17 Z",
  running: "M3 3 L10 10 L3 17 Z M11 3 L18 10 L11 17 Z",
  stopping: "M3 4 H17 L10 13 Z M3 15 H17 V17.5 H3 Z",
  stopped: "M4 4 H16 V16 H4 Z M6.5 6.5 V13.5 H13.5 V6.5 Z",
  tripped: "M6.5 1.5 H13.5 L18.5 6.5 V13.5 L13.5 18.5 H6.5 L1.5 13.5 V6.5 Z M9 5 V11.5 H11 V5 Z M9 13 V15 H11 V13 Z",
  offline: "M3 4.5 L4.5 3 L17 15.5 L15.5 17 Z M15.5 3 L17 4.5 L4.5 17 L3 15.5 Z",
  unknown: "M2 8.75 H7 V11.25 H2 Z M8.5 8.75 H11.5 V11.25 H8.5 Z M13 8.75 H18 V11.25 H13 Z",
  problem: "M10 2 L19 18 H1 Z M9 8 V13 H11 V8 Z M9 14.5 V16.5 H11 V14.5 Z",
  advice: "M10 1.5 A8.5 8.5 0 1 0 10 18.5 A8.5 8.5 0 1 0 10 1.5 Z M9 5 V7 H11 V5 Z M9 8.5 V15 H11 V8.5 Z",
  good: "M2 10.5 L4 8.5 L8 12.5 L16 4 L18 6 L8 16.5 Z",
};

/** A shape for a state; one that is not known gets that of `unknown`. */
export function shape(name) {
  const drawn = svg("svg", { viewBox: "0 0 20 20", "aria-hidden": "true", class: "shape" }, svg("path", { "fill-rule": "evenodd" }));
  reshape(drawn, name);
  return drawn;
}

/** Gives a shape another form. */
export function reshape(drawn, name) {
  attribute(drawn.firstChild, "d", SHAPES[name] ?? SHAPES.unknown);
}

const waiting = [];
const urgent = [];

/** Tells those who listen rather than look; what is urgent interrupts. Repeats within a second are told together. */
export function announce(message, isUrgent = false) {
  const queue = isUrgent ? urgent : waiting;
  if (!queue.includes(message) && queue.length < 8) queue.push(message);
}

setInterval(() => {
  for (const [queue, id] of [[waiting, "polite"], [urgent, "assertive"]]) {
    if (queue.length === 0) continue;
    const [place, message] = [document.getElementById(id), queue.splice(0).join(". ")];
    // The same message is told again only if there was none between.
    text(place, "");
    setTimeout(() => text(place, message), 100);
  }
}, 1000);
