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
  // A4 less its margins; a plot that is wider than the paper would be cut off.
  const paperWidth = 690;
  addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((d) => { d.open = true; });
    boxes.forEach((box) => {
      draw(box);
      Plotly.relayout(box, { autosize: false, width: paperWidth });
    });
  });
  addEventListener("afterprint", () => {
    boxes.forEach((box) => Plotly.relayout(box, { autosize: true, width: null }));
  });
})();
