// Draws the figures, which the page contains as JSON, in the theme of the page: the first at once, the others when idle.
(() => {
  const root = document.documentElement;
  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  const folds = [...document.querySelectorAll("details")];
  const plots = [...document.querySelectorAll(".plot")];
  const figures = new Map(plots.map((div) => [div, JSON.parse(document.getElementById(div.dataset.source).textContent)]));

  const merge = (day, night) => {
    const out = { ...day };
    for (const [key, value] of Object.entries(night)) {
      const both = value && typeof value === "object" && !Array.isArray(value) && day[key] && typeof day[key] === "object";
      out[key] = both ? merge(day[key], value) : value;
    }
    return out;
  };
  const draw = (div) => {
    const figure = figures.get(div);
    const dark = root.dataset.theme === "dark";
    const data = dark ? figure.data.map((trace, i) => merge(trace, figure.dark.data[i])) : figure.data;
    const layout = structuredClone(dark ? figure.dark.layout : figure.layout);
    div.dataset.drawn = root.dataset.theme;
    return Plotly.react(div, data, layout, config).then(() => makeRoom(div, layout));
  };
  // A narrow window breaks the legend into lines, which need room above the panels.
  const LINE = 26;
  const makeRoom = (div, { margin, height }) => {
    const lines = (div.querySelector(".legend")?.getBBox().height ?? LINE) - LINE;
    const more = Math.max(0, Math.ceil(lines));
    if (div.layout.margin.t === margin.t + more) return div;
    return Plotly.relayout(div, { "margin.t": margin.t + more, height: height + more });
  };
  let waiting;
  window.addEventListener("resize", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      for (const div of plots) if (div.layout) makeRoom(div, figures.get(div).layout);
    }, 300);
  });
  const later = window.requestIdleCallback ?? ((work) => setTimeout(work, 1));
  const drawRest = () => {
    const next = plots.find((div) => div.dataset.drawn !== root.dataset.theme && !div.closest("details:not([open])"));
    if (next) draw(next).then(() => later(drawRest, { timeout: 200 }));
    else root.dataset.ready = "true";
  };
  const button = document.getElementById("theme");
  const choose = (theme) => {
    root.dataset.theme = theme;
    root.dataset.ready = "false";
    button.textContent = theme === "dark" ? "Light theme" : "Dark theme";
    drawRest();
  };
  for (const fold of folds) fold.addEventListener("toggle", drawRest); // a folded figure has no width to be drawn in
  button.addEventListener("click", () => choose(root.dataset.theme === "dark" ? "light" : "dark"));
  choose(window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  let before = root.dataset.theme; // paper is white
  window.matchMedia("print").addEventListener("change", (print) => {
    if (print.matches) {
      before = root.dataset.theme;
      root.dataset.theme = "light";
      for (const fold of folds) fold.open = true;
      plots.forEach(draw);
    } else choose(before);
  });
})();
