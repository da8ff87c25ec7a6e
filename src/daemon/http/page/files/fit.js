// Letters as large as their place allows, and never cut.

const SIZES = ["large", "medium", "small", "least"];

/** Gives `element` the largest letters with which all of its text is seen; a text shorter than `sure` has the largest. */
export function fit(element, sure) {
  const sizes = element.textContent.length <= sure ? SIZES.slice(0, 1) : SIZES;
  for (const size of sizes) {
    if (element.dataset.size !== size) element.dataset.size = size;
    if (sizes.length === 1 || element.scrollHeight <= element.clientHeight + 1) return;
  }
}
