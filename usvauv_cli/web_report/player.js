"use strict";
// Draws the recorded episodes on the canvas. Distances are in metres, x to the east and y to the north.
(() => {
  const SIGMAS = 2, TRAIL = 120, NICE = [1, 2, 5];
  const data = JSON.parse(document.getElementById("data").textContent);
  const element = (id) => document.getElementById(id);
  const views = [...document.querySelectorAll(".maps > div")].map((place) => {
    const canvas = place.querySelector("canvas");
    return { place, canvas, context: canvas.getContext("2d"), output: place.querySelector("output"), episode: null };
  });
  const [areaWidth, areaLength] = data.area, [west, south, width, length] = data.shown;

  // An array as `episodes.py` writes it: its shape, and its values one after another.
  function decoded(array) {
    const text = atob(array.data), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const view = new DataView(bytes.buffer), values = new Float64Array(bytes.length * 8 / array.bits);
    for (let i = 0; i < values.length; i++) {
      values[i] = array.low + array.step * (array.bits === 8 ? bytes[i] : view.getUint16(2 * i, true));
    }
    return { shape: array.shape, values, step: array.step };
  }

  const decodedAll = (value) =>
    Array.isArray(value) ? value.map(decodedAll) : typeof value === "object" ? decoded(value) : value;
  const cache = new Map();
  function episodeOf(index) {
    if (!cache.has(index)) {
      const given = data.episodes[index];
      cache.set(index, Object.fromEntries(Object.entries(given).map(([name, value]) => [name, decodedAll(value)])));
    }
    return cache.get(index);
  }

  // Where a time lies between others: the one before, and the share of the way to the next.
  function placeOf(time, times) {
    let low = 0, high = times.length - 1;
    if (time >= times[high]) return [high, 0];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle; else high = middle;
    }
    return [low, Math.max(0, (time - times[low]) / (times[high] - times[low] || 1))];
  }

  // Number `i` of a frame, interpolated; `each` numbers make a frame.
  function between(array, each, [frame, share], i) {
    const at = frame * each + i, now = array.values[at];
    return share ? now + share * (array.values[at + each] - now) : now;
  }

  function pairs(array, place) {
    const count = array.shape[1];
    return Array.from({ length: count }, (_, k) => [0, 1].map((axis) => between(array, 2 * count, place, 2 * k + axis)));
  }

  let episode, context, time = 0, playing = false, last = 0, colours = {}, unit = 1, perMetre = 1, margin = 0, offset = 0;
  const names = ["ink", "muted", "line", "sea", "node", "card", ...Array.from({ length: data.colours }, (_, i) => `series${i}`)];
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  const ofAuv = (k) => colours[`series${k % data.colours}`];
  const pixel = ([x, y]) => [margin + (x - west) * perMetre, margin / 2 + (south + length - y) * perMetre];

  function resize() {
    const ratio = window.devicePixelRatio || 1, across = views[0].canvas.clientWidth;
    margin = Math.min(34, across / 3);
    const most = Math.min(across - margin * 3 / 2, 0.8 * Math.max(window.innerHeight, 480) * width / length);
    perMetre = most / width;
    const tall = length * perMetre + margin * 3 / 2;
    offset = (across - margin * 3 / 2 - most) / 2;
    for (const { canvas, context } of views) {
      canvas.style.height = `${tall}px`;
      canvas.width = Math.round(across * ratio);
      canvas.height = Math.round(tall * ratio);
      context.setTransform(ratio, 0, 0, ratio, offset * ratio, 0);
    }
    unit = Math.min(Math.max(most / 500, 0.75), 1.4);
    draw();
  }

  function line(points, colour, thick, dash = [], alpha = 1) {
    context.globalAlpha = alpha;
    context.strokeStyle = colour;
    context.lineWidth = thick;
    context.setLineDash(dash);
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  function text(words, x, y, colour, align = "center", size = 12) {
    context.font = `600 ${size}px system-ui, sans-serif`;
    context.textAlign = align;
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = colours.sea;
    context.strokeText(words, x, y);
    context.fillStyle = colour;
    context.fillText(words, x, y);
  }

  function drawGround() {
    const step = niceStep(Math.max(width, length) / 5), east = west + width, north = south + length;
    const [left, bottom] = pixel([west, south]), [right, top] = pixel([east, north]);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colours.muted;
    context.textBaseline = "middle";
    for (let x = Math.ceil(west / step) * step; x <= east * 1.0001; x += step) {
      const [at] = pixel([x, south]);
      line([[at, bottom], [at, top]], colours.line, 1);
      context.textAlign = "center";
      context.fillText(x ? x.toFixed(0) : "0 m", at, bottom + 12);
    }
    for (let y = Math.ceil(south / step) * step; y <= north * 1.0001; y += step) {
      const [, at] = pixel([west, y]);
      line([[left, at], [right, at]], colours.line, 1);
      context.textAlign = "right";
      context.fillText(y.toFixed(0), left - 6, at);
    }
  }

  function niceStep(atLeast) {
    for (let decade = 1e-3; ; decade *= 10) for (const n of NICE) if (n * decade >= atLeast * 0.999) return n * decade;
  }

  const nearest = (way) => data.period > 0 ? way - data.period * Math.round(way / data.period) : way;

  // Velocity of the images of a vortex at (dx, dy) from it, as in kernels/flow/vortex.py.
  function images(dx, dy, circulation) {
    if (!(data.period > 0)) return [0, 0];
    const x = dx / data.period, y = dy / data.period, cube = [x ** 3 - 3 * x * y * y, 3 * x * x * y - y ** 3];
    const fourth = [x * cube[0] - y * cube[1], x * cube[1] + y * cube[0]];
    let sum = [0, 0];
    for (const term of [...data.images].reverse()) {
      sum = [term + sum[0] * fourth[0] - sum[1] * fourth[1], sum[0] * fourth[1] + sum[1] * fourth[0]];
    }
    const real = -Math.PI * x - cube[0] * sum[0] + cube[1] * sum[1];
    const imaginary = Math.PI * y - cube[0] * sum[1] - cube[1] * sum[0];
    return [imaginary, real].map((part) => circulation / (2 * Math.PI * data.period) * part);
  }

  // Lamb–Oseen vortices, Eq. 8, and the current of files at the middle of each cell.
  function drawCurrent([frame]) {
    const [, rows, columns] = episode.stream.shape, [centres, circulation, core] = episode.vortex;
    const count = centres.shape[1], arrows = [], when = placeOf(time, episode.stream_time.values);
    let fastest = 0;
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const x = (column + 0.5) * areaWidth / columns, y = (row + 0.5) * areaLength / rows;
        if (x < west || x > west + width || y < south || y > south + length) continue;
        const at = 2 * (row * columns + column);
        let [u, v] = [at, at + 1].map((i) => between(episode.stream, 2 * rows * columns, when, i));
        for (let i = frame * count; i < (frame + 1) * count; i++) {
          const dx = nearest(x - centres.values[2 * i]), dy = nearest(y - centres.values[2 * i + 1]);
          const r2 = dx * dx + dy * dy + 1e-9, [more_u, more_v] = images(dx, dy, circulation.values[i]);
          const turn = -circulation.values[i] / (2 * Math.PI * r2) * Math.expm1(-r2 / core.values[i] ** 2);
          u += more_u - turn * dy;
          v += more_v + turn * dx;
        }
        fastest = Math.max(fastest, Math.hypot(u, v));
        arrows.push([x, y, u, v]);
      }
    }
    if (fastest < 1e-4) return "no current";
    const scale = 0.95 * areaWidth / columns / fastest;
    for (const [x, y, u, v] of arrows) {
      const from = pixel([x - u * scale / 2, y - v * scale / 2]), to = pixel([x + u * scale / 2, y + v * scale / 2]);
      const head = 0.3, bx = from[0] - to[0], by = from[1] - to[1];
      line([from, to], colours.node, 1.1 * unit, [], 0.8);
      line([[to[0] + head * (bx - 0.6 * by), to[1] + head * (by + 0.6 * bx)], to,
        [to[0] + head * (bx + 0.6 * by), to[1] + head * (by - 0.6 * bx)]], colours.node, 1.1 * unit, [], 0.8);
    }
    return `current up to ${fastest.toFixed(2)} m/s`;
  }

  function drawTrails(place) {
    const times = episode.time.values, [now] = place;
    let first = now;
    while (first > 0 && times[first] > time - TRAIL) first--;
    for (const [array, colourOf] of [[episode.boat, () => colours.ink], [episode.auv, ofAuv]]) {
      const count = array.shape[1], stride = Math.max(1, Math.floor((now - first) / 200));
      for (let k = 0; k < count; k++) {
        const points = [];
        for (let frame = first; frame <= now; frame += stride) {
          const at = 2 * (frame * count + k);
          points.push(pixel([array.values[at], array.values[at + 1]]));
        }
        points.push(pixel(pairs(array, place)[k]));
        line(points, colourOf(k), 1.6 * unit, [], 0.5);
      }
    }
  }

  function nodesAt(place) {
    return pairs(episode.node, episode.node.shape[0] > 1 ? place : [0, 0]);
  }

  function drawNodes(place) {
    const nodes = nodesAt(place), count = nodes.length, filled = episode.fill.shape[1] > 0;
    const tracked = episode.tracked.shape[1] ? pairs(episode.tracked, place) : [];
    const most = tracked.length ? 5 : 9, magnify = Number(element("magnify").value);
    const radius = Math.min(Math.max(0.14 * Math.sqrt(width * length / count) * perMetre, 3.5), most * unit);
    for (let i = 0; i < count; i++) {
      const [x, y] = pixel(nodes[i]);
      const fill = filled ? between(episode.fill, count, place, i) : 0, full = fill > 0.995;
      context.fillStyle = colours.card;
      context.strokeStyle = full ? colours.ink : colours.node;
      context.lineWidth = 1.2 * unit;
      context.beginPath();
      if (full) context.rect(x - 0.8 * radius, y - 0.8 * radius, 1.6 * radius, 1.6 * radius);
      else context.arc(x, y, radius, 0, 7);
      context.fill();
      context.fillStyle = colours.node;
      if (full) context.fill();
      else if (fill > 0) {
        context.beginPath();
        context.moveTo(x, y);
        context.arc(x, y, radius, -Math.PI / 2, (2 * fill - 0.5) * Math.PI);
        context.fill();
        context.beginPath();
        context.arc(x, y, radius, 0, 7);
      }
      context.stroke();
    }
    tracked.forEach((estimate, i) => {
      const off = estimate.map((value, axis) => magnify * (value - nodes[i][axis])), arm = 5 * unit;
      if (Math.hypot(...off) > width / 4) return;  // before the first ranges
      const at = pixel(nodes[i].map((value, axis) => value + off[axis]));
      const corners = [[0, -arm], [arm, 0], [0, arm], [-arm, 0], [0, -arm]];
      line([pixel(nodes[i]), at], colours.node, 1 * unit, [], 0.6);
      line(corners.map(([x, y]) => [at[0] + x, at[1] + y]), colours.node, 1.6 * unit);
    });
  }

  function drawAuvs(place) {
    const [frame] = place, nodes = nodesAt(place), auvs = pairs(episode.auv, place), estimates = pairs(episode.estimate, place);
    const count = auvs.length, [axes, angles] = episode.ellipse, magnify = Number(element("magnify").value);
    const later = pairs(episode.auv, [Math.min(frame + 1, episode.time.shape[0] - 1), 0]);
    const before = pairs(episode.auv, [Math.max(frame - 1, 0), 0]);
    auvs.forEach((auv, k) => {
      const at = frame * count + k, here = pixel(auv), colour = ofAuv(k);
      line([here, pixel(nodes[episode.target.values[at]])], colour, 1.4 * unit, [1.5, 4]);
      const seen = pixel(auv.map((value, axis) => value + magnify * (estimates[k][axis] - value)));
      context.save();
      context.beginPath();
      const [left, top] = pixel([west, south + length]);
      context.rect(left, top, width * perMetre, length * perMetre);
      context.clip();
      context.strokeStyle = colour;
      context.lineWidth = 1.4 * unit;
      context.setLineDash([4, 2.5]);
      context.beginPath();
      const size = [0, 1].map((axis) => SIGMAS * magnify * perMetre * axes.values[2 * at + axis]);
      context.ellipse(...seen, ...size, -angles.values[at], 0, 7);
      context.stroke();
      context.restore();
      const arm = 4 * unit;
      line([[seen[0] - arm, seen[1]], [seen[0] + arm, seen[1]]], colour, 1.6 * unit);
      line([[seen[0], seen[1] - arm], [seen[0], seen[1] + arm]], colour, 1.6 * unit);
    });
    auvs.forEach((auv, k) => {
      const [x, y] = pixel(auv), own = episode.heading.shape[1] > 0;  // clockwise from north below
      const heading = own ? Math.PI / 2 - between(episode.heading, count, place, k)
        : Math.atan2(later[k][0] - before[k][0], later[k][1] - before[k][1]);
      if (episode.hovering.values[frame * count + k] > 0.5) {
        context.strokeStyle = ofAuv(k);
        context.lineWidth = 2 * unit;
        context.beginPath();
        context.arc(x, y, 13 * unit, 0, 7);
        context.stroke();
      }
      shape([[0, -9], [6, 7], [0, 4], [-6, 7]], x, y, heading, ofAuv(k));
      text(String(k + 1), x + 13 * unit, y - 11 * unit, ofAuv(k));
    });
  }

  function shape(points, x, y, heading, colour) {
    context.save();
    context.translate(x, y);
    context.rotate(heading);
    context.scale(unit, unit);
    context.beginPath();
    points.forEach(([px, py], i) => (i ? context.lineTo(px, py) : context.moveTo(px, py)));
    context.closePath();
    context.fillStyle = colour;
    context.strokeStyle = colours.card;
    context.lineWidth = 1.2;
    context.fill();
    context.stroke();
    context.restore();
  }

  function drawBoats(place) {
    const ahead = pairs(episode.boat, [Math.min(place[0] + 1, episode.time.shape[0] - 1), 0]);
    const behind = pairs(episode.boat, [Math.max(place[0] - 1, 0), 0]);
    pairs(episode.boat, place).forEach((boat, b) => {
      const heading = Math.atan2(ahead[b][0] - behind[b][0], ahead[b][1] - behind[b][1]);
      shape([[0, -11], [5, -4], [5, 9], [-5, 9], [-5, -4]], ...pixel(boat), heading, colours.ink);
    });
  }

  function draw() {
    for (const view of views) if (view.episode) ({ episode, context } = view), drawView(view);
    episode = views[0].episode;
  }

  function drawView({ canvas, output, name }) {
    const place = placeOf(time, episode.time.values);
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.restore();
    drawGround();
    const current = element("current").checked ? drawCurrent(place) : "";
    drawTrails(place);
    drawNodes(place);
    drawAuvs(place);
    drawBoats(place);
    const auvs = pairs(episode.auv, place);
    const apart = (estimates, truth) => estimates.map((at, k) => Math.hypot(at[0] - truth[k][0], at[1] - truth[k][1]))
      .map((metres) => metres.toFixed(metres < 10 ? 2 : 0)).join(", ");
    const minutes = Math.floor(time / 60), seconds = String(Math.floor(time % 60)).padStart(2, "0");
    const said = [`${minutes}:${seconds} min`, `${between(episode.energy, 1, place, 0).toFixed(1)} Wh`];
    if (episode.fill.shape[1]) said.push(`${between(episode.data, 1, place, 0).toFixed(1)} Mbit`);
    said.push(`estimates off by ${apart(pairs(episode.estimate, place), auvs)} m`);
    if (episode.tracked.shape[1]) said.push(`targets by ${apart(pairs(episode.tracked, place), nodesAt(place))} m`);
    output.value = [...(views[1].episode ? [name] : []), ...said, ...(current ? [current] : [])].join(" · ");
  }

  function show(seconds) {
    const times = episode.time.values;
    time = Math.min(Math.max(seconds, times[0]), times[times.length - 1]);
    element("time").value = time;
    draw();
  }

  function setPlaying(wanted) {
    playing = wanted;
    element("play").textContent = playing ? "Pause" : "Play";
    last = performance.now();
    if (playing) requestAnimationFrame(advance);
  }

  function advance(now) {
    if (!playing) return;
    const end = episode.time.values[episode.time.values.length - 1];
    show(time + Math.min(now - last, 100) / 1000 * Number(element("speed").value));
    last = now;
    if (time >= end) setPlaying(false); else requestAnimationFrame(advance);
  }

  function offer(id, values, words, chosen) {
    element(id).replaceChildren(...values.map((value, i) => new Option(words[i], value, value === chosen, value === chosen)));
  }

  // The episodes on the maps: one, and another beside it or none (−1).
  function choose(index, other) {
    [index, other].forEach((number, i) => {
      views[i].episode = number < 0 ? null : episodeOf(number);
      views[i].name = number < 0 ? "" : data.episodes[number].name;
    });
    views[1].place.hidden = !views[1].episode;
    episode = views[0].episode;
    const times = episode.time.values, slider = element("time");
    slider.min = times[0];
    slider.max = times[times.length - 1];
    element("resolution").textContent = `${(500 * Math.max(episode.auv.step, episode.estimate.step, episode.boat.step)).toPrecision(2)} mm`;
    time = Math.min(Math.max(time, times[0]), times[times.length - 1]);
    slider.value = time;
    resize();
  }

  readColours();
  offer("episode", data.episodes.map((_, i) => i), data.episodes.map(({ name }) => name), 0);
  const begun = episodeOf(0), duration = begun.time.values[begun.time.values.length - 1];
  const speeds = [];
  for (let decade = 1; decade * 5 < duration; decade *= 10) {
    for (const n of NICE) if (n * decade * 5 <= duration) speeds.push(n * decade);
  }
  if (!speeds.length) speeds.push(1);
  const usual = speeds.reduce((best, speed) => (Math.abs(duration / speed - 40) < Math.abs(duration / best - 40) ? speed : best));
  offer("speed", speeds, speeds.map((speed) => `× ${speed}`), usual);
  // Errors are drawn so large that the median ellipse is seen, at most a twentieth of the area.
  const majors = Array.from(begun.ellipse[0].values).sort((a, b) => a - b), usualError = SIGMAS * majors[majors.length >> 1];
  const factors = [1, 2, 5, 10, 20, 50, 100];
  const fitting = factors.filter((factor) => factor * usualError <= Math.min(width, length) / 20);
  offer("magnify", factors, factors.map((factor) => `× ${factor}`), fitting.length ? fitting[fitting.length - 1] : 1);
  const numbers = data.episodes.map((_, i) => i), several = numbers.length > 1;
  offer("other", [-1, ...numbers], ["none", ...data.episodes.map(({ name }) => name)], several ? 1 : -1);
  element("beside").hidden = !several;
  time = begun.time.values[0];
  const chosen = () => choose(Number(element("episode").value), Number(element("other").value));
  for (const id of ["episode", "other"]) element(id).addEventListener("change", chosen);
  for (const id of ["magnify", "current"]) element(id).addEventListener("change", draw);
  element("play").addEventListener("click", () => {
    if (!playing && time >= Number(element("time").max)) show(0);
    setPlaying(!playing);
  });
  element("time").addEventListener("input", () => show(Number(element("time").value)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); draw(); });
  addEventListener("resize", resize);
  chosen();
})();
