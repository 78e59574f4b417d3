"""Draw on paper: figures and pages as PDF, one figure as SVG."""
