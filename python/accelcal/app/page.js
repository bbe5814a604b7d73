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
// Saves a figure as it is seen, with the headline that stands above it.
function savePicture(plotId, headlineId) {
  const plot = getElement(plotId), drawn = plot.$el;
  const text = document.getElementById(`c${headlineId}`).innerText;
  const letters = Math.max(20, Math.floor(drawn.clientWidth / 8)), lines = [""];
  for (const word of text.split(" ")) {
    if ((lines.at(-1) + word).length > letters) lines.push("");
    lines[lines.length - 1] += `${word} `;
  }
  const room = 20 * lines.length + 8, layout = { ...drawn.layout, margin: { ...drawn.layout.margin } };
  layout.margin.t = (layout.margin.t ?? 20) + room;
  const size = { width: drawn.clientWidth, height: drawn.clientHeight + room, scale: 2, format: "png" };
  layout.title = { text: lines.join("<br>"), x: 0.01, xanchor: "left", y: 1 - 10 / size.height, yref: "container",
    yanchor: "top", font: { size: 15 } };
  const name = text.replace(/[^\w]+/g, "_").slice(0, 60);
  return plot.Plotly.downloadImage({ data: drawn.data, layout }, { ...size, filename: `accelcal_${name}` });
}
