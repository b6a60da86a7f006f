// The part of plotly.js that reports use. Its core has the trace "scatter"; a trace that is not listed here is not in the bundle.
const plotly = require("plotly.js/lib/core");

plotly.register([
  require("plotly.js/lib/bar"),
  require("plotly.js/lib/scatter3d"),
]);

module.exports = plotly;
