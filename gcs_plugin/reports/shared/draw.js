"use strict";
// Unpacks the library and the figures, draws each when it comes near the view, and all of them
// before printing.
(async () => {
  const unpack = async (id) => {
    const packed = document.getElementById(id).textContent;
    const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
    const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(plain).text();
  };
  const config = {
    responsive: true,
    displaylogo: false,
    scrollZoom: false,
    plotlyServerURL: "",
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: { scale: 2 },
  };
  const boxes = [...document.querySelectorAll("[data-figure]")];
  if (!window.DecompressionStream) {
    boxes.forEach((box) => { box.textContent = "This browser is too old for the charts."; });
    return;
  }
  const library = document.createElement("script");
  library.textContent = await unpack("library");
  document.head.append(library);
  const figures = new Map();
  for (const box of boxes) figures.set(box, await unpack(box.dataset.figure));
  const draw = (box) => {
    if (box.dataset.drawn) return;
    box.dataset.drawn = "yes";
    const figure = JSON.parse(figures.get(box));
    box.dataset.height = figure.layout.height;
    box.textContent = "";
    Plotly.newPlot(box, figure.data, figure.layout, config);
  };
  const near = new IntersectionObserver(
    (seen) => seen.filter((s) => s.isIntersecting).forEach((s) => {
      near.unobserve(s.target);
      draw(s.target);
    }),
    { rootMargin: "800px" },
  );
  boxes.forEach((box) => near.observe(box));
  // A4 less its margins, drawn wider and then made smaller as a whole, type too: nothing is cut off,
  // nothing overlaps, and a flight fits four pages.
  const SMALLER = 0.6;
  const onPaper = (box) => ({
    autosize: false,
    width: (box.closest(".pair") ? 335 : 690) / SMALLER,
    height: box.closest(".pair") ? 500 : 0.66 * box.dataset.height,
  });
  addEventListener("beforeprint", () => {
    document.querySelectorAll("details:not(.aside)").forEach((d) => { d.open = true; });
    boxes.forEach((box) => {
      draw(box);
      box.style.zoom = SMALLER;
      Plotly.relayout(box, onPaper(box));
    });
  });
  addEventListener("afterprint", () => boxes.forEach((box) => {
    box.style.zoom = "";
    Plotly.relayout(box, { autosize: true, width: null, height: Number(box.dataset.height) });
  }));
})();
