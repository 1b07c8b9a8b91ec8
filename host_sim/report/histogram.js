// Durations as bars over a logarithmic axis, as SVG: sharp on paper, coloured by look.css.
"use strict";

/** {title, note, edges_s, counts, total, mean_s, p99_s, max_s} as a figure. Heights are logarithms of counts, so
    that one late tick in a million is seen. */
function histogramFigure({ title, note, edges_s: edges, counts, total, mean_s: mean, p99_s: p99, max_s: max }) {
  const [width, height, left, right, top, bottom] = [560, 170, 44, 14, 16, 26], base = height - bottom;
  // Durations below the first bin (1 ns) are zero and would stretch the axis.
  const zeros = edges[0] < 1e-9 && counts.length > 1 ? counts[0] : 0, first = zeros ? 1 + counts.slice(1).findIndex((n) => n > 0) : 0;
  [edges, counts] = [edges.slice(first), counts.slice(first)];
  const edge = (k) => Math.log10(edges[k]);
  let [lo, hi] = [edge(0), edge(counts.length)];
  if (hi - lo < 1) [lo, hi] = [(lo + hi) / 2 - 0.5, (lo + hi) / 2 + 0.5];
  const decades = Math.max(1, Math.ceil(Math.log10(Math.max(...counts) + 0.5)));
  const toX = (log) => left + (log - lo) / (hi - lo) * (width - left - right);
  const toY = (count) => base - (Math.log10(count) + 0.3) / (decades + 0.3) * (base - top);  // one is a bar as well
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "histogram",
    "aria-label": `${title}: mean ${duration(mean)}, 99 % within ${duration(p99)}, largest ${duration(max)}` });
  for (let k = 0; k <= decades; k += Math.ceil(decades / 4)) {
    picture.append(svg("path", { class: "grid", d: `M${left} ${toY(10 ** k)}H${width - right}` }),
      svg("text", { x: left - 6, y: toY(10 ** k) + 4, "text-anchor": "end" }, k ? power(k) : "1"));
  }
  const steps = hi - lo > 3 ? [1] : hi - lo > 1.5 ? [1, 3] : [1, 2, 5];
  for (let decade = Math.floor(lo); decade <= hi; ++decade) {
    for (const step of steps) {
      const at = decade + Math.log10(step);
      if (at < lo || at > hi) continue;
      picture.append(svg("path", { class: "grid", d: `M${toX(at)} ${top}V${base}` }),
        svg("text", { x: toX(at), y: base + 16, "text-anchor": "middle" }, duration(10 ** at).replace(/\.0+(?=\s)/, "")));
    }
  }
  counts.forEach((count, k) => {
    if (count > 0) picture.append(svg("rect", { x: toX(edge(k)) + 0.5, width: Math.max(1, toX(edge(k + 1)) - toX(edge(k)) - 1), y: toY(count),
      height: base - toY(count) }, svg("title", {}, `${duration(10 ** edge(k))} to ${duration(10 ** edge(k + 1))}: ${count} of ${total}`)));
  });
  return el("figure", {}, el("figcaption", {}, el("h2", {}, title), el("span", { class: "note" }, note)), picture,
    el("p", { class: "note" }, `${total} counted${zeros ? `, ${zeros} of them zero` : ""}: mean ${duration(mean)}, 99 % within ${duration(p99)}, largest ${duration(max)}`));
}
