"use strict";
// Draws each figure when it comes near the view, and all of them before printing.
(() => {
  const config = {
    responsive: true,
    displaylogo: false,
    scrollZoom: false,
    plotlyServerURL: "",
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: { scale: 2 },
  };
  const draw = (box) => {
    if (box.dataset.drawn) return;
    box.dataset.drawn = "yes";
    const figure = JSON.parse(document.getElementById(box.dataset.figure).textContent);
    box.textContent = "";
    Plotly.newPlot(box, figure.data, figure.layout, config);
  };
  const boxes = [...document.querySelectorAll("[data-figure]")];
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
