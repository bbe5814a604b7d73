// Keeps the keyboard where it was when a screen is drawn anew, and the axes of figures from screen readers.
addEventListener("unhandledrejection", event => {
  // A plot that is removed while it is being resized raises this error; it is harmless.
  if (String(event.reason).includes("Resize must be passed a displayed plot")) event.preventDefault();
});
(() => {
  let last = null;
  const named = element => (element.getAttribute("aria-label") || element.innerText || "").trim();
  addEventListener("pointerdown", () => { last = null; });
  addEventListener("focusin", event => {
    const content = event.target.closest(".body");
    if (event.target !== content) last = content ? { tag: event.target.tagName, name: named(event.target) } : null;
  });
  new MutationObserver(() => {
    // A figure has its caption; numbers of its axes without their lines say nothing.
    document.querySelectorAll("svg.main-svg:not([aria-hidden])").forEach(svg => svg.setAttribute("aria-hidden", "true"));
    const content = document.querySelector(".body");
    if (!last || !content || document.activeElement !== document.body) return;
    const again = [...content.querySelectorAll(last.tag)].find(element => named(element) === last.name);
    (again || content).focus({ preventScroll: true });
  }).observe(document.documentElement, { childList: true, subtree: true });
})();
