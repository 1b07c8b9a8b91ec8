// The mechanism on a canvas: poses from joint angles, world and screen, links, paths. Knows neither page nor data.
//
// geometry  {type: "five_bar" | "rr", half_base, legs: [{l1, l2}, ...]}, m; one leg stands for both
// angles    [theta11, theta12, theta21, theta22] (leg 2 in its mirrored frame) or [theta1, theta2], rad
// pose      {bases, elbows, tips: [[x, y], ...] per leg, effector: [x, y]}, m
// palette   name => colour: ink, muted, rule, panel, c0, c1 (legs), c6 (effector)
"use strict";

const Mechanism = (() => {
  /** Legs with their base and the sense of their x axis. */
  function legs(geometry) {
    const sides = geometry.type === "five_bar" ? [1, -1] : [1];
    return sides.map((side, index) => {
      const { l1, l2 } = geometry.legs?.[index] ?? geometry.legs?.[0] ?? {};
      return { side, base: side * (geometry.type === "five_bar" ? geometry.half_base ?? 0 : 0), l1, l2 };
    });
  }

  /** The pose that these joint angles give; the tips of the two legs agree as far as the loop is closed. */
  function pose(geometry, angles) {
    const all = legs(geometry), bases = all.map(({ base }) => [base, 0]);
    const elbows = all.map(({ side, base, l1 }, j) => [base + side * l1 * Math.cos(angles[2 * j]), l1 * Math.sin(angles[2 * j])]);
    const tips = all.map(({ side, l2 }, j) => {
      const outer = angles[2 * j] + angles[2 * j + 1];
      return [elbows[j][0] + side * l2 * Math.cos(outer), elbows[j][1] + l2 * Math.sin(outer)];
    });
    return { bases, elbows, tips, effector: tips[0] };
  }

  /** The modes are the signs of these: sin theta_j2 per leg, and D2 = sin(phi12 + phi22), null for RR. */
  function modes(geometry, angles) {
    const working = legs(geometry).map((_, j) => Math.sin(angles[2 * j + 1]));
    return { working, assembly: working.length === 2 ? Math.sin(angles[0] + angles[1] + angles[2] + angles[3]) : null };
  }

  /** Bounding box {x: [lo, hi], y: [lo, hi]} of points; what is not finite does not count. Of none: a unit box. */
  function box(points) {
    let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [x, y] of points) {
      if (!Number.isFinite(x + y)) continue;
      [x0, x1, y0, y1] = [Math.min(x0, x), Math.max(x1, x), Math.min(y0, y), Math.max(y1, y)];
    }
    return x0 <= x1 ? { x: [x0, x1], y: [y0, y1] } : { x: [-0.5, 0.5], y: [-0.5, 0.5] };
  }

  /** The box in the middle of a canvas of width x height pixels, equal scales, padding on all sides (px). */
  function fit({ x: [x0, x1], y: [y0, y1] }, width, height, padding = 24) {
    const scale = Math.max(1e-9, Math.min((width - 2 * padding) / Math.max(x1 - x0, 1e-9), (height - 2 * padding) / Math.max(y1 - y0, 1e-9)));
    const [mx, my] = [(x0 + x1) / 2, (y0 + y1) / 2];
    return { scale, width, height, toScreen: ([x, y]) => [width / 2 + (x - mx) * scale, height / 2 - (y - my) * scale],
      toWorld: ([px, py]) => [mx + (px - width / 2) / scale, my - (py - height / 2) / scale] };
  }

  /** A path of the screen; NaN: a gap. */
  function path(c, points, style, dashes = []) {
    Object.assign(c, { lineJoin: "round", globalAlpha: 1 }, style).setLineDash(dashes);
    c.beginPath();
    let pen = "moveTo";
    for (const [px, py] of points) {
      const gap = !Number.isFinite(px + py);
      if (!gap) c[pen](px, py);
      pen = gap ? "moveTo" : "lineTo";
    }
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  /** Grid lines through the origin of the world, about 60 px apart; returns their distance, m. */
  function drawGrid(c, view, palette) {
    const step = roundStep(60 / view.scale), [x0, y1] = view.toWorld([0, 0]), [x1, y0] = view.toWorld([view.width, view.height]);
    const style = { strokeStyle: palette("rule"), lineWidth: 1 }, crisp = (p) => Math.round(p) + 0.5;
    for (const [axis, lo, hi] of [[0, x0, x1], [1, y0, y1]]) {
      for (let k = Math.ceil(lo / step); k * step <= hi; ++k) {
        const at = crisp(view.toScreen([k * step, k * step])[axis]);
        path(c, axis ? [[0, at], [view.width, at]] : [[at, 0], [at, view.height]], style);
      }
    }
    return step;
  }

  /** A path of the world. */
  const drawPath = (c, view, points, style, dashes) => path(c, points.map(view.toScreen), style, dashes);

  function dot(c, [px, py], radius, fill, rim = fill) {
    Object.assign(c, { fillStyle: fill, strokeStyle: rim, lineWidth: 1.5, globalAlpha: 1 }).beginPath();
    c.arc(px, py, radius, 0, 2 * Math.PI);
    c.fill();
    c.stroke();
  }

  /** Bases on the ground, links, joints, effector. A pose that is not finite is not drawn. */
  function drawPose(c, view, pose, palette) {
    const at = view.toScreen, tip = at(pose.effector);
    pose.bases.forEach((base, j) => {
      const [px, py] = at(base), elbow = at(pose.elbows[j]), foot = (dx) => [px + dx, py + 16], tint = palette(`c${j}`);
      path(c, [foot(-20), foot(20), foot(14), [px, py], foot(-14)], { strokeStyle: palette("muted"), lineWidth: 1.5 });
      if (Number.isFinite(elbow[0] + elbow[1] + tip[0] + tip[1])) {
        path(c, [elbow, tip], { strokeStyle: tint, lineWidth: 7, lineCap: "round", globalAlpha: 0.5 });
        path(c, [[px, py], elbow], { strokeStyle: tint, lineWidth: 9, lineCap: "round", globalAlpha: 0.9 });
        dot(c, elbow, 4.5, palette("panel"), palette("ink"));
      }
      dot(c, [px, py], 6, palette("panel"), palette("ink"));
    });
    c.lineCap = "butt";
    if (Number.isFinite(tip[0] + tip[1])) dot(c, tip, 5.5, palette("c6"), palette("ink"));
  }

  return { legs, pose, modes, box, fit, dot, path, drawGrid, drawPath, drawPose };
})();
