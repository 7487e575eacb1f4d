// Sorting of tables, light and dark, figures of bokeh, and the scene: maps, a machine in its pose.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const root = document.documentElement;

  // ------------------------------------------------------------------------------ tables
  const number = (text) => {
    const match = text.replace("−", "-").match(/^[^0-9+-]*([+-]?[0-9]*\.?[0-9]+(e[+-]?[0-9]+)?)/i);
    return match ? Number(match[1]) : NaN;
  };
  const compare = (a, b) => {
    const [x, y] = [number(a), number(b)];
    if (Number.isNaN(x) || Number.isNaN(y)) return a.localeCompare(b);
    return x - y;
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      const sort = () => {
        const falling = head.getAttribute("aria-sort") === "ascending";
        heads.forEach((one) => one.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", falling ? "descending" : "ascending");
        const rows = [...table.tBodies[0].rows];
        const text = (row) => row.cells[column].textContent.trim();
        rows.sort((a, b) => (falling ? -1 : 1) * compare(text(a), text(b)));
        table.tBodies[0].append(...rows);
      };
      head.tabIndex = 0;
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
    });
  }
  const mark = () => {
    for (const one of document.querySelectorAll(".scroll")) {
      one.classList.toggle("wide", one.scrollWidth > one.clientWidth + 1);
    }
  };
  addEventListener("resize", mark);
  mark();

  // ------------------------------------------------------------------------------ themes
  const system = matchMedia("(prefers-color-scheme: dark)");
  const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  const onTheme = [];
  const themed = () => onTheme.forEach((f) => f());
  $("theme").addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    themed();
  });
  system.addEventListener("change", themed);

  // ----------------------------------------------------------------------------- figures
  const awaited = document.querySelectorAll("[data-root-id]").length;
  const figures = () => (window.Bokeh ? Bokeh.documents.flatMap((one) => one.roots()) : []);
  const recolour = () => {
    const style = getComputedStyle(root), ink = style.getPropertyValue("--ink").trim();
    const line = style.getPropertyValue("--strong").trim();
    for (const one of figures()) {
      one.title.text_color = ink;
      one.outline_line_color = line;
      for (const part of [...one.below, ...one.left]) {
        if (part.type === "Legend") {
          part.label_text_color = ink;
          continue;
        }
        part.axis_label_text_color = part.major_label_text_color = ink;
        part.axis_line_color = part.major_tick_line_color = part.minor_tick_line_color = line;
      }
      for (const grid of one.center) grid.grid_line_color = style.getPropertyValue("--line").trim();
    }
  };
  const load = async () => {  // the library, which is compressed, then the figures
    const bytes = Uint8Array.from(atob($("library").textContent), (c) => c.charCodeAt(0));
    const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    for (const code of [await new Response(unpacked).text(), $("figures").textContent]) {
      const script = document.createElement("script");
      script.textContent = code;
      document.body.append(script);
    }
  };
  if (awaited && root.classList.contains("runs")) load();
  const whenDrawn = (fill) => {
    if (!root.classList.contains("runs")) return;
    if (figures().length < awaited) {
      setTimeout(() => whenDrawn(fill), 30);
      return;
    }
    onTheme.push(recolour);
    recolour();
    fill();
    root.dataset.ready = "figures";
  };

  const holder = $("scene");
  if (!holder) {
    if (awaited) whenDrawn(() => {});
    return;
  }

  // ------------------------------------------------------------------------------- scene
  const scene = JSON.parse(holder.textContent);
  const table = (packed) => {
    const bytes = Uint8Array.from(atob(packed.base64), (c) => c.charCodeAt(0));
    const whole = new (packed.bits === 32 ? Int32Array : Int16Array)(bytes.buffer);
    const width = packed.scale.length, rows = [];
    for (let at = 0; at < whole.length; at += width) {
      rows.push(packed.scale.map((scale, k) => whole[at + k] * scale));
    }
    return rows;
  };
  const machines = scene.machines.map((one) => ({
    ...one,
    cells: table(one.cells),
    frequencies: table(one.frequencies),
    poses: table(one.poses),
    positions: table(one.positions),
    placements: table(one.placements),
    pivots: table(one.pivots),
    swings: table(one.swings),
    loops: one.loops && table(one.loops),
  }));
  const narrowest = (one, pose) => scene.joints[Math.round(one.loops[pose].at(-1))][0];
  const limiting = (one, pose, mode = 0) => one.parts[one.poses[pose][1 + mode]];
  const frequency = (one, pose, mode = 0) => one.positions[pose][scene.joints.length + mode];
  const loadCase = (one, pose) => scene.cases[one.poses[pose][0] - 1];
  const long = (metres) => `${(metres * scene.length[0]).toFixed(scene.length[2])} ${scene.length[1]}`;
  const poseWords = (one, pose) => scene.joints
    .map(([name, unit, digits], j) => `${name} ${one.positions[pose][j].toFixed(digits)}${unit === "°" ? unit : ` ${unit}`}`)
    .join(", ");

  // ----------------------------------------------------------------------------- drawing
  const svg = $("drawing");
  const state = { machine: machines.length - 1, pose: 0, mode: 0, phase: 1, swings: false };
  const place = ([a, b, x, c, d, y], [u, v]) => [a * u + b * v + x, c * u + d * v + y];
  const add = (parent, tag, attributes, words) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (words) add(element, "title", {}).textContent = words;
    parent.append(element);
    return element;
  };
  // words beside their points, one below the other where they would meet, with a line to the point
  const label = (parent, marks, size, right) => {
    const written = [];
    for (const { at, words } of marks.sort((a, b) => b.at[1] - a.at[1])) {
      const long = 0.62 * size * words.length;
      const x = Math.min(at[0] + 1.2 * size, right - long);
      let y = at[1] + 0.6 * size;
      for (const one of written) {
        if (x < one.x + one.long && one.x < x + long && y > one.y - 1.3 * size) y = one.y - 1.3 * size;
      }
      written.push({ x, y, long });
      add(parent, "line", { x1: at[0], y1: -at[1], x2: x, y2: -y - 0.3 * size, class: "leader", "stroke-width": size / 16 });
      add(parent, "text", { x, y: -y, "font-size": size, "stroke-width": size / 3 }).textContent = words;
    }
  };
  const path = (rings) => rings
    .map((ring) => `M${ring.map(([x, y]) => `${x.toFixed(4)},${(-y).toFixed(4)}`).join("L")}Z`)
    .join("");

  // matrices of the bodies and places of all points at rest
  const placed = (one, pose) => {
    const numbers = one.placements[pose], matrices = [one.standing];
    let next = 0;
    while (matrices.length < one.bodies.length) matrices.push(numbers.slice(next, next += 6));
    const points = one.points.map((point) => {
      if (point.at) return place(matrices[point.body], point.at);
      next += 2;
      return [numbers[next - 2], numbers[next - 1]];
    });
    return { matrices, points };
  };
  // how far the joints go in the mode, and last the tool [m]
  const ways = (one, pose) => {
    const count = one.joints.length + 1;
    return one.swings[pose].slice(state.mode * count, (state.mode + 1) * count);
  };
  const after = ([a, b, x, c, d, y], [e, f, u, g, h, v]) =>
    [a * e + b * g, a * f + b * h, a * u + b * v + x, c * e + d * g, c * f + d * h, c * u + d * v + y];
  const joint = (hinge, x, y, way) => {
    if (!hinge) return [1, 0, way * x, 0, 1, way * y];
    const [c, s] = [Math.cos(way), Math.sin(way)];
    return [c, -s, x - c * x + s * y, s, c, y - s * x - c * y];
  };
  // the same by `factor` swings away from rest: rigid bodies about their joints, from the root outwards
  const swung = (one, pose, factor) => {
    const rest = placed(one, pose), moved = [[1, 0, 0, 0, 1, 0]], pivots = one.pivots[pose];
    const far = ways(one, pose);
    const motion = (body) => {
      const [carrier, hinge] = one.joints[body - 1] ?? [], k = body - 1;
      moved[body] ??= after(motion(carrier), joint(hinge, pivots[2 * k], pivots[2 * k + 1], factor * far[k]));
      return moved[body];
    };
    const points = rest.points.map((at, k) => (one.points[k].body === null ? at : place(motion(one.points[k].body), at)));
    rest.points.forEach((at, k) => {
      const pins = one.bars.filter(({ ends }) => ends[1] === k).map(({ ends }) => ends[0]);
      if (pins.length === 2) points[k] = knee(at, pins.map((pin) => rest.points[pin]), pins.map((pin) => points[pin]));
    });
    return { matrices: rest.matrices.map((matrix, body) => after(motion(body), matrix)), points };
  };
  // where two bars of their lengths at rest meet, on the same side of their pins
  const knee = (at, pins, [from, to]) => {
    const length = (a, b) => Math.hypot(b[0] - a[0], b[1] - a[1]);
    const side = (p, q) => (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0]);
    const [near, far] = pins.map((pin) => length(pin, at)), apart = length(from, to) || 1;
    const along = (near ** 2 - far ** 2 + apart ** 2) / (2 * apart);
    const aside = Math.sign(side(...pins)) * Math.sqrt(Math.max(near ** 2 - along ** 2, 0));
    const [x, y] = [0, 1].map((k) => (to[k] - from[k]) / apart);
    return [from[0] + along * x - aside * y, from[1] + along * y + aside * x];
  };
  const bar = (from, to, begin, end, width) => {
    const span = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...span) || 1;
    const [x, y] = span.map((s) => s / length), half = width / 2;
    const at = (along, side) => [from[0] + along * x - side * y, from[1] + along * y + side * x];
    return [at(begin, half), at(end ?? length, half), at(end ?? length, -half), at(begin, -half)];
  };
  const outline = (parent, one, { matrices, points }, style) => {
    const width = style.width;
    one.bodies.forEach((rings, k) => rings.length && (k || !style.name) && add(parent, "path", {
      d: path(rings.map((ring) => ring.map((at) => place(matrices[k], at)))),
      class: style.name || "body", "stroke-width": width, "fill-rule": "nonzero",
      ...(style.dashes ? { "stroke-dasharray": style.dashes } : {}),
    }));
    for (const cylinder of one.cylinders) {
      const [from, to] = cylinder.ends.map((k) => points[k]);
      const words = `${cylinder.count > 1 ? `${cylinder.count} × ` : ""}${cylinder.name}`;
      const rod = path([bar(from, to, 0, null, cylinder.rod_width)]);
      const barrel = path([bar(from, to, ...cylinder.barrel, cylinder.barrel_width)]);
      const dashes = style.dashes ? { "stroke-dasharray": style.dashes } : {};
      add(parent, "path", { d: rod, class: style.name || "rod", "stroke-width": width, ...dashes }, words);
      const paint = style.name ? {} : { style: `fill: ${cylinder.colour}` };
      add(parent, "path", { d: barrel, class: style.name || "barrel", "stroke-width": width, ...dashes, ...paint }, words);
    }
    for (const link of one.bars) {
      const [[x1, y1], [x2, y2]] = link.ends.map((k) => points[k]);
      const look = style.name ? { class: style.name, "stroke-width": width, "stroke-dasharray": style.dashes } : { class: "bar", "stroke-width": 5 * width };
      add(parent, "line", { x1, y1: -y1, x2, y2: -y2, ...look, "data-bar": link.name }, link.name);
    }
    if (style.name) return;
    points.forEach(([x, y], k) => add(parent, "circle", {
      cx: x, cy: -y, r: 3.5 * width, class: "pin", "stroke-width": 1.3 * width, "data-pin": one.points[k].name,
    }, one.points[k].words));
  };

  // today's pins and cylinders beside the new ones, in the same pose: pins have their plates
  const arrows = (parent, one, here, width) => {
    const before = machines[0];
    if (machines.length < 2 || one === before || before.points.length !== one.points.length) return [];
    const old = before.points.map((point, k) => (point.at ? place(here.matrices[point.body], point.at) : here.points[k]));
    outline(parent, { ...before, bodies: [] }, { matrices: [], points: old }, { name: "old", width: 1.6 * width, dashes: 5 * width });
    const moves = [];
    one.points.forEach((point, k) => {
      const [from, to] = [old[k], here.points[k]], moved = Math.hypot(to[0] - from[0], to[1] - from[1]);
      if (!point.at || moved < 5e-4) return;
      add(parent, "line", { x1: from[0], y1: -from[1], x2: to[0], y2: -to[1], class: "arrow", "stroke-width": 2 * width });
      add(parent, "path", { d: path([arrowhead(from, to, 8 * width)]), class: "arrow", "stroke-width": 0 });
      moves.push({ at: to, words: `${point.name} ${long(moved)}` });
    });
    return moves;
  };
  const arrowhead = (from, to, size) => {
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
    const at = (turn, far) => [to[0] + far * Math.cos(angle + turn), to[1] + far * Math.sin(angle + turn)];
    return [at(0, size / 2), at(2.5, size), at(-2.5, size)];
  };
  const box = (one) => {
    const ends = [-1, 0, 1].flatMap((factor) => {
      const { matrices, points } = swung(one, state.pose, factor);
      return [...points, ...one.bodies.flatMap((rings, k) => rings.flat().map((at) => place(matrices[k], at)))];
    });
    const [x, y] = [0, 1].map((k) => ends.map((at) => at[k]).filter(Number.isFinite));
    return [Math.min(...x), Math.max(...x), Math.min(one.ground, ...y), Math.max(...y)];
  };
  const draw = () => {
    if (!svg) return;
    const one = machines[state.machine];
    const [left, right, low, high] = box(one), size = Math.max(right - left, high - low);
    const room = 0.06 * size, wide = right - left + 2 * room, tall = high - low + 2 * room;
    svg.setAttribute("viewBox", [left - room, -high - room, wide, tall].join(" "));
    svg.style.aspectRatio ||= `${wide} / ${tall}`;  // of the first pose; others fit into its place
    const width = wide / Math.max(Math.min(svg.clientWidth, svg.clientHeight * wide / tall), 200);
    svg.replaceChildren();
    const from = [left - room, one.ground], to = [right + room, one.ground];
    add(svg, "line", { x1: from[0], y1: -from[1], x2: to[0], y2: -to[1], class: "ground", "stroke-width": width });
    const rest = placed(one, state.pose);
    outline(svg, one, rest, { width });
    const moves = arrows(svg, one, rest, width);
    outline(svg, one, swung(one, state.pose, state.phase), { name: "swung", width: 1.3 * width, dashes: 3 * width });
    label(svg, moves, 13 * width, right + room);
    const loops = one.loops ? `bandwidth ${one.loops[state.pose][0].toFixed(3)} Hz, narrowest loop ${narrowest(one, state.pose)}; natural frequency ` : "";
    $("pose").textContent = `${one.label}: ${poseWords(one, state.pose)}, load case ${loadCase(one, state.pose)}: ${loops}`
      + `${frequency(one, state.pose, state.mode).toFixed(3)} Hz, limited by ${limiting(one, state.pose, state.mode)}; dashed red: ${modeWords(state.mode)}, `
      + `${swingWords(one, rest)}${machines.length > 1 && state.machine ? `; dashed blue: ${machines[0].label}` : ""}`;
  };
  const swingWords = (one, rest) => {
    const far = ways(one, state.pose).at(-1), ends = [rest.points.at(-1), swung(one, state.pose, 1).points.at(-1)];
    const seen = Math.hypot(...[0, 1].map((k) => ends[1][k] - ends[0][k]));
    return `${long(far)} at the tool${seen < far / 2 ? ", most of it across the picture" : ""}`;
  };
  const modeWords = (mode) => ["the lowest mode", "the second mode", "the third mode"][mode];
  let begun = null;
  const swing = (time) => {
    if (!state.swings) return;
    begun ??= time;
    state.phase = Math.sin((time - begun) / 1000 * 2 * Math.PI * 0.7);
    draw();
    requestAnimationFrame(swing);
  };
  if (svg) {
    for (let mode = 0; mode < machines[0].poses[0].length - 1; mode += 1) {
      const choice = document.createElement("option");
      [choice.value, choice.textContent] = [mode, modeWords(mode)];
      $("mode").append(choice);
    }
    $("mode").addEventListener("change", () => {
      state.mode = Number($("mode").value);
      draw();
    });
    $("swing").addEventListener("click", () => {
      state.swings = !state.swings;
      $("swing").setAttribute("aria-pressed", state.swings);
      [begun, state.phase] = [null, 1];
      if (state.swings) requestAnimationFrame(swing);
      else draw();
    });
  }
  draw();

  // ------------------------------------------------------------------------------- maps
  const controls = { case: $("case"), plane: $("plane"), statistic: $("statistic") };
  if (!controls.case) return;
  const option = (select, value, words) => {
    const element = document.createElement("option");
    [element.value, element.textContent] = [value, words];
    select.append(element);
  };
  option(controls.case, 0, "all, the lowest counts");
  scene.cases.forEach((name, k) => option(controls.case, k + 1, name));
  scene.planes.forEach(({ x, y }, k) => option(controls.plane, k, y ? `${x.name}, ${y.name}` : x.name));

  const LEAST = ["lowest of the poses", "least 5 % of a cell", "least median of a cell"];
  let shown = machines.map(() => []);
  const model = (name) => {
    for (const one of Bokeh.documents) {
      const known = one.get_model_by_name(name);
      if (known) return known;
    }
    return null;
  };
  const middle = (axis, k) => (axis.edges[k] + axis.edges[k + 1]) / 2;
  const columns = (one, rows, plane, statistic) => {
    const { x, y } = plane, count = y ? y.middles.length : 1;
    const data = { x: [], y: [], width: [], height: [], value: [], words: [], pose: [], load: [], part: [], spread: [], frequency: [], others: [] };
    for (const row of rows) {
      const [, , cell, pose] = one.cells[row], [lowest, low, median] = one.frequencies[row];
      const [across, up] = [Math.floor(cell / count), cell % count];
      data.x.push(y ? middle(x, across) : x.middles[across]);
      data.value.push(one.frequencies[row][statistic]);
      data.y.push(y ? middle(y, up) : data.value.at(-1));
      data.width.push(x.edges[across + 1] - x.edges[across]);
      data.height.push(y ? y.edges[up + 1] - y.edges[up] : 0);
      const hertz = frequency(one, pose), loops = one.loops && one.loops[pose];
      data.words.push(`${(loops ? loops[0] : hertz).toFixed(3)} Hz, the lowest of the cell`);
      data.pose.push(poseWords(one, pose));
      data.load.push(loadCase(one, pose));
      data.part.push(loops ? narrowest(one, pose) : limiting(one, pose));
      data.frequency.push(`${hertz.toFixed(3)} Hz, limited by ${limiting(one, pose)}`);
      data.others.push(loops ? `common gains ${loops[1].toFixed(3)}, no pressure feedback ${loops[2].toFixed(3)} Hz` : "");
      data.spread.push(`lowest ${lowest.toFixed(3)}, 5 % ${low.toFixed(3)}, median ${median.toFixed(3)} Hz`);
    }
    return data;
  };
  const axisLabel = ({ name, unit }) => `${name} [${unit === "°" ? "deg" : unit}]`;
  const range = (axis, edges) => {
    const [low, high] = [edges[0], edges.at(-1)];
    const spare = scene.planes[0].y ? 0 : 0.03 * (high - low); // of rings about points
    [axis.start, axis.end] = [low - spare, high + spare];
  };
  const fill = () => {
    const [load_case, index, statistic] = [controls.case, controls.plane, controls.statistic].map((one) => Number(one.value));
    const plane = scene.planes[index];
    shown = machines.map((one) => [...one.cells.keys()].filter((k) => one.cells[k][0] === index && one.cells[k][1] === load_case));
    const data = machines.map((one, k) => columns(one, shown[k], plane, statistic));
    const values = data.flatMap((one) => one.value);
    const [low, high] = values.length ? [Math.min(...values), Math.max(...values)] : [0, 1];
    $("low").textContent = low.toFixed(2);
    $("high").textContent = high.toFixed(2);
    machines.forEach((one, k) => {
      const colours = model(`colours-${k}`), map = model(`map-${k}`), source = model(`cells-${k}`);
      [colours.low, colours.high] = [low, high > low ? high : low + 1];
      range(map.x_range, plane.x.edges);
      if (plane.y) range(map.y_range, plane.y.edges);
      else [map.y_range.start, map.y_range.end] = [0, 1.1 * high];
      map.below[0].axis_label = axisLabel(plane.x);
      map.left[0].axis_label = plane.y ? axisLabel(plane.y) : scene.quantity;
      const least = Math.min(...data[k].value);
      map.title.text = values.length ? `${one.label}\n${LEAST[statistic]} ${least.toFixed(3)} Hz` : `${one.label}\n `;
      source.selected.indices = [];
      source.data = data[k];
      const at = data[k].value.indexOf(least);
      model(`marks-${k}`).data = at < 0 ? { x: [], y: [] } : { x: [data[k].x[at]], y: [data[k].y[at]] };
    });
  };
  window.armdesignPick = (index, indices) => {
    if (!indices.length) return;
    const one = machines[index], source = model(`cells-${index}`);
    [state.machine, state.pose] = [index, one.cells[shown[index][indices[0]]][3]];
    model(`marks-${index}`).data = { x: [source.data.x[indices[0]]], y: [source.data.y[indices[0]]] };
    draw();
  };
  whenDrawn(() => {
    Object.values(controls).forEach((one) => one.addEventListener("change", fill));
    fill();
  });
})();
