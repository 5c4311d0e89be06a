"use strict";
// A study's report: draws the panels that stand in the page as data, and the views that one can work in.
(() => {
  const NAMED = { "#33475b": "figure", "#1f77b4": "accent", "#d1495b": "mark", "#b4bcc4": "pale", "#6a4c93": "other" };  // colors that turn with the page's scheme
  const style = getComputedStyle(document.documentElement), themed = (name) => style.getPropertyValue(`--${name}`).trim();
  const shade = (color) => (NAMED[color] ? `var(--${NAMED[color]})` : color);
  const ACCENT = "#1f77b4", CELL = "#26384a";
  let INK, MARK, HIT, EDGE;  // of canvases
  const theme = () => { [INK, MARK, HIT, EDGE] = ["figure", "mark", "hit", "edge"].map(themed); };
  theme();
  const page = JSON.parse(document.getElementById("report-data").textContent);
  const SVG = "http://www.w3.org/2000/svg";
  const make = (name, attributes = {}, parent = null, text = null) => {
    const node = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, shade(value));
    if (text !== null) node.textContent = text;
    if (parent) parent.appendChild(node);
    return node;
  };
  const html = (name, parent, words = null, type = "") => {
    const node = document.createElement(name);
    if (words !== null) node.textContent = words;
    if (type) node.className = type;
    if (parent) parent.appendChild(node);
    return node;
  };
  const finite = (v) => v !== null && Number.isFinite(v);
  const room = (document.querySelector("section h2") || document.body).clientWidth, narrow = room < 600;  // a phone
  const named = (table) => {  // each cell with the head of its column, which stands beside it on a phone
    const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent);
    for (const line of table.rows) if (line.parentNode !== table.tHead) [...line.cells].forEach((cell, k) => { cell.dataset.head = heads[k]; });
  };

  // ------------------------------------------------------------------------------------------------ scales
  const plain = (v, digits = 5) => {
    if (!finite(v)) return "–";
    const size = Math.abs(v);
    if (size !== 0 && (size < 1e-3 || size >= 1e6)) return v.toExponential(Math.min(3, digits - 1)).replace(/\.?0+e/, "e").replace("-", "−").replace("e-", "e−");
    return String(Number(v.toPrecision(digits))).replace("-", "−");
  };
  const written = (c, v) => plain(v, v ? Math.max(2, Math.min(15, Math.max(0, c.decimals) + 1 + Math.floor(Math.log10(Math.abs(v))))) : 2);  // with the column's decimals
  const ticks = (low, high, most) => {
    const step = (high - low) / Math.max(1, most), power = 10 ** Math.floor(Math.log10(step || 1));
    const wide = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= step * 0.75) || power;
    const found = [];
    for (let k = Math.ceil(low / wide - 1e-9); k * wide <= high + 1e-9 * wide; k++) found.push(Number((k * wide).toPrecision(12)));
    return found;
  };
  const marksOf = (c, most) => (c.words ? c.words.map((word, n) => [n, word]) : ticks(c.low, c.high, most).map((v) => [v, plain(v)]));
  const extent = (lists) => {
    let low = Infinity, high = -Infinity;
    for (const list of lists) for (const v of list) if (finite(v)) { if (v < low) low = v; if (v > high) high = v; }
    if (!(high >= low)) return [0, 1];
    const pad = (high - low) * 0.05 || Math.abs(high) * 0.05 || 1;
    return [low - pad, high + pad];
  };

  // ------------------------------------------------------------------------------------------------ panels
  const shownTip = document.getElementById("tip");
  const tell = (event, lines) => {
    if (!lines) { shownTip.style.display = "none"; return; }
    shownTip.replaceChildren(...lines.map((line) => html("div", null, line)));
    shownTip.style.display = "block";
    const wide = shownTip.offsetWidth, x = event.clientX + 14;
    shownTip.style.left = `${Math.min(x, window.innerWidth - wide - 8)}px`;
    shownTip.style.top = `${Math.min(event.clientY + 14, window.innerHeight - shownTip.offsetHeight - 8)}px`;
  };
  const frame = (panel, box) => {
    const { words } = panel.y, reach = (list) => 6.4 * Math.max(...list.map((w) => w.length));  // of the longest word [px]
    const own = panel.width || 340, given = narrow && !panel.cells ? Math.min(own, room) : own;
    const beside = words ? 14 + reach(words) : 62, above = words && !panel.cells && beside > 0.45 * given;  // long words stand above their rows
    const tilted = panel.x.turned ? reach(panel.x.words) : 0, left = above ? 14 : Math.max(beside, 0.79 * tilted - 30);
    const bottom = tilted ? Math.max(96, 30 + 0.62 * tilted) : 46, top = panel.title ? 24 : 10;
    const width = given + (panel.cells ? Math.max(0, left - 320) : 0), height = (panel.height || 250) + (above ? 20 * words.length : 0) + (tilted ? bottom - 96 : 0);
    const svg = make("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": panel.title || panel.y.label || "" }, box);
    const inner = { left, top, right: width - 12, bottom: height - bottom };
    const along = (axis, lists, from, to) => {
      const [low, high] = axis.range || (axis.words ? [-0.6, axis.words.length - 0.4] : extent(lists));
      return { low, high, at: (v) => from + ((v - low) / (high - low || 1)) * (to - from) };
    };
    const xs = panel.series.flatMap((s) => [s.x, s.low_x, s.high_x].filter(Boolean));
    const ys = panel.series.flatMap((s) => (s.kind === "bars" ? [s.y, [0]] : [s.y, s.low, s.high]).filter(Boolean));
    const x = along(panel.x, xs, inner.left, inner.right), y = along(panel.y, ys, inner.bottom, inner.top);
    if (panel.title) make("text", { x: Math.max(2, Math.min(inner.left, width - 6.7 * panel.title.length)), y: 15, class: "head" }, svg, panel.title);
    const marks = (axis, scale, most) => (axis.words ? axis.words.map((w, k) => [k, w]) : ticks(scale.low, scale.high, most).map((v) => [v, plain(v)]));
    for (const [v, word] of marks(panel.x, x, 4)) {
      const px = x.at(v);
      if (!panel.cells) make("line", { x1: px, x2: px, y1: inner.top, y2: inner.bottom, class: "grid" }, svg);
      const turned = panel.x.turned ? { transform: `rotate(-38 ${px} ${inner.bottom + 12})`, "text-anchor": "end" } : { "text-anchor": "middle" };
      make("text", { x: px, y: inner.bottom + 15, ...turned }, svg, word);
    }
    for (const [v, word] of marks(panel.y, y, 5)) {
      const py = y.at(v);
      if (!panel.cells) make("line", { x1: inner.left, x2: inner.right, y1: py, y2: py, class: "grid" }, svg);
      const at = above ? { x: inner.left, y: y.at(v + 0.5) + 4 } : { x: inner.left - 6, y: py + 4, "text-anchor": "end" };
      const text = make("text", at, svg, word), most = width - at.x - 2;
      if (above && text.getComputedTextLength() > most) for (const [key, value] of [["textLength", most], ["lengthAdjust", "spacingAndGlyphs"]]) text.setAttribute(key, value);
    }
    if (panel.x.label) make("text", { x: (inner.left + inner.right) / 2, y: height - 8, "text-anchor": "middle", class: "axis" }, svg, panel.x.label);
    if (panel.y.label) {
      const middle = (inner.top + inner.bottom) / 2, most = Math.floor((2 * Math.min(middle, height - middle)) / 6.2), lines = [""];
      for (const part of panel.y.label.split(/(?<=[._ ]|->)/)) { if ((lines[lines.length - 1] + part).length > most) lines.push(""); lines[lines.length - 1] += part; }
      lines.slice(0, 2).forEach((line, n) => make("text", { x: 11 + 12 * n, y: middle, "text-anchor": "middle", class: "axis", transform: `rotate(-90 ${11 + 12 * n} ${middle})` }, svg, line));
    }
    return { svg, x, y, inner };
  };
  const path = (series, x, y, ys) => series.x.map((v, k) => (finite(ys[k]) ? `${x.at(v).toFixed(1)},${y.at(ys[k]).toFixed(1)}` : null)).filter(Boolean);
  const drawn = {
    band: ({ svg, x, y }, s, color) => make("polygon", { points: [...path(s, x, y, s.high), ...path(s, x, y, s.low).reverse()].join(" "), fill: color, opacity: 0.18 }, svg),
    line: ({ svg, x, y }, s, color) => make("polyline", { points: path(s, x, y, s.y).join(" "), fill: "none", stroke: color, "stroke-width": s.width || 1.8, "stroke-dasharray": s.dash || "" }, svg),
    points: ({ svg, x, y }, s, color) => s.x.forEach((v, k) => {
      if (!finite(v) || !finite(s.y[k])) return;
      const dot = make("circle", { cx: x.at(v).toFixed(1), cy: y.at(s.y[k]).toFixed(1), r: s.size || 2.2, fill: color, opacity: s.opacity || 0.8 }, svg);
      if (s.notes) { dot.onmousemove = (e) => tell(e, s.notes[k].split("\n")); dot.onmouseleave = () => tell(null, null); }
    }),
    errors: ({ svg, x, y }, s, color) => s.x.forEach((v, k) => {
      if (!finite(s.low[k]) || !finite(s.high[k])) return;
      const [px, a, b] = [x.at(v), y.at(s.low[k]), y.at(s.high[k])];
      make("path", { d: `M${px - 3},${a}h6M${px - 3},${b}h6M${px},${a}V${b}`, stroke: color, fill: "none", opacity: 0.75 }, svg);
    }),
    spans: ({ svg, x, y }, s, color) => s.y.forEach((at, k) => {
      if (!finite(s.low_x[k]) || !finite(s.high_x[k])) return;
      const [py, a, b] = [y.at(at), x.at(s.low_x[k]), x.at(s.high_x[k])];
      make("path", { d: `M${a},${py - 3}v6M${b},${py - 3}v6M${a},${py}H${b}`, stroke: color, fill: "none", opacity: 0.75 }, svg);
    }),
    columns: ({ svg, x, y }, s, color) => s.y.forEach((v, k) => {
      const [a, b] = [x.at(s.low_x[k]), x.at(s.high_x[k])];
      make("rect", { x: a + 0.5, width: Math.max(0.5, b - a - 1), y: y.at(v), height: Math.max(0, y.at(0) - y.at(v)), fill: color, opacity: 0.8 }, svg);
    }),
    rows: ({ svg, x, y }, s, color) => s.y.forEach((at, k) => {
      const [a, b] = [x.at(s.from ? s.from[k] : 0), x.at((s.from ? s.from[k] : 0) + s.x[k])], thick = (s.thick || 0.36) * Math.abs(y.at(1) - y.at(0));
      make("rect", { x: a, width: Math.max(0, b - a), y: y.at(at) - thick / 2, height: thick, fill: color }, svg);
      if (s.error && s.error[k]) make("path", { d: `M${x.at(s.x[k] - s.error[k])},${y.at(at)}H${x.at(s.x[k] + s.error[k])}`, stroke: "#33475b" }, svg);
    }),
    cells: ({ svg, x, y }, s) => s.x.forEach((cx, k) => {
      const v = s.value[k], w = Math.abs(x.at(1) - x.at(0)), h = Math.abs(y.at(1) - y.at(0));
      if (!finite(v)) return;
      const part = Math.min(1, Math.abs(v)), color = v > 0 ? [178, 24, 43] : [33, 102, 172];
      const fill = `rgb(${color.map((c) => Math.round(255 + (c - 255) * part)).join(",")})`;
      make("rect", { x: x.at(cx) - w / 2, y: y.at(s.y[k]) - h / 2, width: w, height: h, fill }, svg);
      make("text", { x: x.at(cx), y: y.at(s.y[k]) + 4, "text-anchor": "middle", fill: part > 0.6 ? "white" : s.faint[k] ? "#7d8890" : CELL, class: "cell" }, svg, (v > 0 ? "+" : "") + v.toFixed(2).replace("-", "−"));
    }),
    level: ({ svg, inner, y }, s, color) => make("line", { x1: inner.left, x2: inner.right, y1: y.at(s.y[0]), y2: y.at(s.y[0]), stroke: color, "stroke-dasharray": "5 4" }, svg),
    upright: ({ svg, inner, x }, s, color) => make("line", { y1: inner.top, y2: inner.bottom, x1: x.at(s.x[0]), x2: x.at(s.x[0]), stroke: color, "stroke-dasharray": s.dash || "" }, svg),
  };
  for (const box of document.querySelectorAll(".panels")) {
    for (const panel of JSON.parse(box.querySelector("script").textContent)) {
      const place = html("figure", box);
      place.style.maxWidth = `${panel.width || 340}px`;
      if ((panel.width || 340) > 400) place.className = "broad";
      const view = frame(panel, place);
      for (const s of panel.series) drawn[s.kind](view, s, s.color || ACCENT);
      const named = panel.series.filter((s) => s.label);
      if (named.length) {
        const legend = html("figcaption", place);
        for (const s of named) { const word = html("span", legend, s.label); word.style.setProperty("--color", shade(s.color || ACCENT)); }
      }
    }
  }

  // ------------------------------------------------------------------------------------------------ folded parts
  const folds = () => [...document.querySelectorAll("section > details:not(.figure), section details.fold")];
  let closed = [];
  addEventListener("beforeprint", () => { closed = folds().filter((part) => !part.open); for (const part of closed) part.open = true; });
  addEventListener("afterprint", () => { for (const part of closed) part.open = false; });
  const unfold = () => {  // the part that a link leads to
    let part = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (part && part.firstElementChild && part.firstElementChild.tagName === "DETAILS") part.firstElementChild.open = true;
    for (; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
  };
  addEventListener("hashchange", unfold);
  unfold();

  // ------------------------------------------------------------------------------------------------ the rows
  const rows = page;
  if (!rows) {
    for (const table of document.querySelectorAll("table")) named(table);
    return;
  }
  const columns = rows.columns, count = rows.variant.length;
  const filters = new Map();  // column -> [low, high]
  const mask = new Uint8Array(count).fill(1);
  let kept = count, marked = -1, front = new Uint8Array(count), views = [], waiting = false;
  const chosenColumns = new Set(rows.shown.slice(0, narrow ? 4 : undefined)), crossed = rows.crossed.slice(0, narrow ? 3 : undefined);
  let tinted = rows.tint;
  for (const column of columns) {
    const held = column.values.filter(finite);
    const [low, high] = column.words ? [-0.4, column.words.length - 0.6] : extent([held]);
    Object.assign(column, { low, high });
  }
  const SHADES = 24;  // from blue over gray to red by the tinted column; rows are drawn shade by shade
  const mix = (a, b, t) => `rgb(${a.map((v, i) => Math.round(v + (b[i] - v) * t)).join(",")})`;
  const shades = Array.from({ length: SHADES }, (_, n) => { const t = (2 * n) / (SHADES - 1); return t < 1 ? mix([31, 95, 175], [160, 150, 170], t) : mix([160, 150, 170], [209, 60, 75], t - 1); });
  let byShade = [];
  const tint = (index) => {
    tinted = index;
    byShade = Array.from({ length: SHADES }, () => []);
    const c = columns[index];
    for (let k = 0; k < count; k++) byShade[Math.min(SHADES - 1, Math.max(0, Math.floor((SHADES * (c.values[k] - c.low)) / (c.high - c.low || 1)) || 0))].push(k);
  };
  tint(tinted);
  const value = (c, k) => (c.words ? c.words[c.values[k]] ?? "–" : `${written(c, c.values[k])}${c.unit ? " " + c.unit : ""}`);
  const command = (k) => {
    if (!rows.folder) return null;
    const place = rows.archives && rows.archives[k];
    return place ? `warpchain view ${rows.folder}/${place[0]} --variant ${place[1]}` : `warpchain study play ${rows.folder} ${rows.variant[k]}`;
  };
  const FIRST = 15;  // rows of the list of chosen variants at first
  const copier = (cell, words) => {  // a button that copies a command
    const button = html("button", cell, "copy");
    button.onclick = async (e) => { e.stopPropagation(); try { await navigator.clipboard.writeText(words); button.textContent = "copied"; } catch { button.textContent = "select it"; } };
  };
  const placeOf = new Map(rows.variant.map((number, k) => [number, k]));
  const playable = () => {  // the commands of variants that stand in tables
    for (const code of document.querySelectorAll(".design code")) copier(code.parentNode, code.textContent);
    if (rows.folder) for (const table of document.querySelectorAll("table.rows")) {
      const at = [...table.tHead.rows[0].cells].findIndex((cell) => cell.textContent === "variant");
      html("th", table.tHead.rows[0], "play it", "play");
      for (const line of table.tBodies[0].rows) {
        const number = Number(line.cells[at].textContent), k = placeOf.get(number), cell = html("td", line, null, "play");
        const words = k === undefined ? `warpchain study play ${rows.folder} ${number}` : command(k);
        html("code", cell, `${words} `); copier(cell, words);
      }
    }
  };
  const about = (k) => [`variant ${rows.variant[k]}`, ...columns.filter((c, i) => chosenColumns.has(i)).map((c) => `${c.name} = ${value(c, k)}`), ...(command(k) ? [command(k)] : [])];

  const choose = () => {
    mask.fill(1);
    for (const [index, [low, high]] of filters) {
      const values = columns[index].values;
      for (let k = 0; k < count; k++) if (!(finite(values[k]) && values[k] >= low && values[k] <= high)) mask[k] = 0;
    }
    kept = mask.reduce((sum, v) => sum + v, 0);
    front = new Uint8Array(count);
    if (rows.objectives.length > 1) {
      const costs = rows.objectives.map(([index, sign]) => [columns[index].values, sign]);
      const order = [];
      for (let k = 0; k < count; k++) if (mask[k] && costs.every(([v]) => finite(v[k]))) order.push(k);
      const cost = (k, m) => costs[m][1] * costs[m][0][k];
      order.sort((a, b) => { for (let m = 0; m < costs.length; m++) { const d = cost(a, m) - cost(b, m); if (d) return d; } return a - b; });
      const held = [];
      for (const k of order) {
        const beaten = held.some((j) => { let less = false; for (let m = 0; m < costs.length; m++) { const d = cost(j, m) - cost(k, m); if (d > 0) return false; if (d < 0) less = true; } return less; });
        if (!beaten) { held.push(k); front[k] = 1; }
      }
    }
  };
  const refresh = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; choose(); for (const view of views) view(); });
  };
  const filter = (index, range) => { if (range && range[1] > range[0]) filters.set(index, range); else filters.delete(index); refresh(); };
  const canvasOf = (parent, width, height) => {
    const canvas = html("canvas", parent), dense = 2;
    Object.assign(canvas, { width: width * dense, height: height * dense });
    canvas.style.width = `${width}px`;
    canvas.style.maxWidth = "100%";
    const pen = canvas.getContext("2d");
    pen.scale(dense, dense);
    const spot = (e) => { const box = canvas.getBoundingClientRect(); return [((e.clientX - box.left) * width) / box.width, ((e.clientY - box.top) * height) / box.height]; };
    return { canvas, pen, spot };
  };
  const dragged = (canvas, spot, begin, move, end) => {
    canvas.addEventListener("pointerdown", (e) => {
      const from = spot(e), what = begin(...from);
      if (what === null || what === undefined) return;
      canvas.setPointerCapture(e.pointerId);
      const go = (f) => move(what, from, spot(f));
      const stop = (f) => { canvas.removeEventListener("pointermove", go); canvas.removeEventListener("pointerup", stop); end(what, from, spot(f)); };
      canvas.addEventListener("pointermove", go);
      canvas.addEventListener("pointerup", stop);
    });
  };

  // ------------------------------------------------------------------------------------------------ parallel coordinates
  const parallel = (parent) => {
    const width = narrow ? room : 1120, height = 330, top = 56, bottom = 300;
    const { canvas, pen, spot } = canvasOf(parent, width, height);
    canvas.id = "parallel";
    const order = () => [...chosenColumns].sort((a, b) => a - b);
    const place = (list, i) => (list.length < 2 ? width / 2 : 60 + (i * (width - 120)) / (list.length - 1));
    const up = (c, v) => bottom - ((v - c.low) / (c.high - c.low || 1)) * (bottom - top);
    const back = (c, py) => c.low + ((bottom - py) / (bottom - top)) * (c.high - c.low);
    const thread = (list, k) => {
      let down = false;
      list.forEach((index, i) => {
        const v = columns[index].values[k];
        if (!finite(v)) { down = false; return; }
        const [px, py] = [place(list, i), up(columns[index], v)];
        if (down) pen.lineTo(px, py); else pen.moveTo(px, py);
        down = true;
      });
    };
    const draw = () => {
      const list = order();
      pen.clearRect(0, 0, width, height);
      pen.lineWidth = 0.6;
      pen.strokeStyle = "rgba(150,160,170,0.16)";
      pen.beginPath();
      const rare = Math.max(1, Math.ceil((count - kept) / 3000));  // what is left out is only a ground
      for (let k = 0; k < count; k += rare) if (!mask[k]) thread(list, k);
      pen.stroke();
      pen.globalAlpha = Math.min(0.9, Math.max(0.12, 120 / Math.max(kept, 1)));
      byShade.forEach((some, n) => {
        pen.strokeStyle = shades[n];
        for (let start = 0; start < some.length; start += 60) {  // few strokes, but enough that lines add up
          pen.beginPath();
          for (const k of some.slice(start, start + 60)) if (mask[k]) thread(list, k);
          pen.stroke();
        }
      });
      pen.globalAlpha = 1;
      pen.lineWidth = 2.2;
      pen.strokeStyle = HIT;
      for (let k = 0; k < count; k++) if (k === marked) { pen.beginPath(); thread(list, k); pen.stroke(); }
      list.forEach((index, i) => {
        const c = columns[index], px = place(list, i);
        pen.strokeStyle = INK;
        pen.lineWidth = 1.2;
        pen.beginPath(); pen.moveTo(px, top); pen.lineTo(px, bottom); pen.stroke();
        pen.fillStyle = INK;
        pen.font = "11px system-ui, sans-serif";
        pen.textAlign = "center";
        const words = c.name.split(/(?<=[._ ]|->)/), lines = [""], most = list.length < 2 ? 40 : Math.floor((width - 120) / (list.length - 1) / 6.2);
        for (const w of words) { if ((lines[lines.length - 1] + w).length > most) lines.push(""); lines[lines.length - 1] += w; }
        if (c.unit) lines.push(`[${c.unit}]`);
        lines.slice(-5).forEach((line, n, all) => pen.fillText(line.trim(), px, top - 10 - 12 * (all.length - 1 - n)));
        pen.font = "10px system-ui, sans-serif";
        pen.textAlign = i === list.length - 1 ? "right" : "left";
        const side = i === list.length - 1 ? -5 : 5;
        for (const [v, word] of marksOf(c, 5)) {
          pen.strokeStyle = themed("card"); pen.lineWidth = 3; pen.strokeText(word, px + side, up(c, v) + 3);
          pen.fillText(word, px + side, up(c, v) + 3);
        }
        const range = filters.get(index);
        if (range) {
          const [a, b] = [up(c, Math.min(range[1], c.high)), up(c, Math.max(range[0], c.low))];
          pen.fillStyle = "rgba(224,138,0,0.28)"; pen.strokeStyle = HIT; pen.lineWidth = 1.4;
          pen.fillRect(px - 9, a, 18, b - a); pen.strokeRect(px - 9, a, 18, b - a);
        }
      });
    };
    const near = (x) => { const list = order(); let best = null; list.forEach((index, i) => { if (Math.abs(place(list, i) - x) < 16) best = index; }); return best; };
    dragged(canvas, spot, (x) => near(x), (index, from, to) => {
      const ends = [back(columns[index], from[1]), back(columns[index], to[1])].sort((a, b) => a - b);
      if (Math.abs(to[1] - from[1]) > 3) filter(index, ends);
    }, (index, from, to) => { if (Math.abs(to[1] - from[1]) <= 3) filter(index, null); });
    canvas.addEventListener("mousemove", (e) => { canvas.style.cursor = near(spot(e)[0]) === null ? "default" : "ns-resize"; });
    views.push(draw);
  };

  // ------------------------------------------------------------------------------------------------ scatters
  const PAD = 8, FEW = 4;  // margin of a scatter without words at its edge, and ticks along it
  const scatter = (parent, size, across, upward, options) => {
    const { canvas, pen, spot } = canvasOf(parent, size[0], size[1]);
    if (options.id) canvas.id = options.id;
    const left = options.edge ? 58 : PAD, bottom = size[1] - (options.edge ? 38 : PAD), top = PAD, right = size[0] - PAD;
    const cx = () => columns[across()], cy = () => columns[upward()];
    const ax = (v) => left + ((v - cx().low) / (cx().high - cx().low || 1)) * (right - left);
    const ay = (v) => bottom - ((v - cy().low) / (cy().high - cy().low || 1)) * (bottom - top);
    const bx = (p) => cx().low + ((p - left) / (right - left)) * (cx().high - cx().low);
    const by = (p) => cy().low + ((bottom - p) / (bottom - top)) * (cy().high - cy().low);
    const spread = (c, k) => (c.words ? ((k * 7919) % 97) / 97 - 0.5 : 0) * 0.5;  // words side by side
    const dot = (k, r) => { const [x, y] = [cx().values[k], cy().values[k]]; if (finite(x) && finite(y)) pen.fillRect(ax(x + spread(cx(), k)) - r, ay(y + spread(cy(), k)) - r, 2 * r, 2 * r); };
    const draw = () => {
      pen.clearRect(0, 0, size[0], size[1]);
      pen.strokeStyle = EDGE; pen.lineWidth = 1; pen.strokeRect(left, top, right - left, bottom - top);
      pen.fillStyle = INK; pen.font = "10px system-ui, sans-serif";
      if (!options.edge) {
        pen.strokeStyle = "#8a96a1"; pen.beginPath();
        for (const [v] of marksOf(cx(), FEW)) { pen.moveTo(ax(v), bottom); pen.lineTo(ax(v), bottom - 4); }
        for (const [v] of marksOf(cy(), FEW)) { pen.moveTo(left, ay(v)); pen.lineTo(left + 4, ay(v)); }
        pen.stroke();
      } else {
        pen.textAlign = "center";
        for (const [v, w] of marksOf(cx(), 5)) pen.fillText(w, ax(v), bottom + 13);
        pen.fillText(cx().name + (cx().unit ? ` [${cx().unit}]` : ""), (left + right) / 2, size[1] - 8);
        pen.textAlign = "right";
        for (const [v, w] of marksOf(cy(), 5)) pen.fillText(w, left - 5, ay(v) + 3);
        pen.save(); pen.translate(11, (top + bottom) / 2); pen.rotate(-Math.PI / 2); pen.textAlign = "center"; pen.fillText(cy().name + (cy().unit ? ` [${cy().unit}]` : ""), 0, 0); pen.restore();
      }
      const r = count > 4000 ? 0.9 : count > 600 ? 1.3 : 2;
      pen.fillStyle = "rgba(170,178,186,0.35)";
      for (let k = 0; k < count; k++) if (!mask[k]) dot(k, r);
      byShade.forEach((some, n) => { pen.fillStyle = shades[n]; for (const k of some) if (mask[k] && !front[k]) dot(k, r); });
      pen.fillStyle = MARK;
      if (options.front) {
        const held = [];
        for (let k = 0; k < count; k++) if (front[k]) held.push(k);
        for (const k of held) dot(k, r + 1.6);
        for (const [k, word] of rows.recommended) if (finite(cx().values[k])) {
          pen.strokeStyle = HIT; pen.lineWidth = 2; pen.beginPath(); pen.arc(ax(cx().values[k]), ay(cy().values[k]), 8, 0, 7); pen.stroke();
          pen.fillStyle = INK; pen.textAlign = "left"; pen.font = "bold 12px system-ui, sans-serif"; pen.fillText(word, ax(cx().values[k]) + 10, ay(cy().values[k]) - 6); pen.fillStyle = MARK;
        }
      } else for (let k = 0; k < count; k++) if (front[k]) dot(k, r + 0.8);
      if (marked >= 0) { pen.fillStyle = HIT; dot(marked, r + 2.5); }
      const [fx, fy] = [filters.get(across()), filters.get(upward())];
      if (fx || fy) {
        const [a, b] = fx ? [ax(Math.max(fx[0], cx().low)), ax(Math.min(fx[1], cx().high))] : [left, right];
        const [c, d] = fy ? [ay(Math.min(fy[1], cy().high)), ay(Math.max(fy[0], cy().low))] : [top, bottom];
        pen.strokeStyle = HIT; pen.lineWidth = 1.2; pen.strokeRect(a, c, b - a, d - c);
      }
    };
    const closest = (x, y) => {
      let best = -1, gap = 100;
      for (let k = 0; k < count; k++) {
        const [u, v] = [cx().values[k], cy().values[k]];
        if (!finite(u) || !finite(v)) continue;
        const d = (ax(u + spread(cx(), k)) - x) ** 2 + (ay(v + spread(cy(), k)) - y) ** 2 - (mask[k] ? 30 : 0);
        if (d < gap) { gap = d; best = k; }
      }
      return best;
    };
    dragged(canvas, spot, () => 1, (_, from, to) => {
      if (Math.abs(to[0] - from[0]) < 4 || Math.abs(to[1] - from[1]) < 4) return;
      filter(across(), [bx(from[0]), bx(to[0])].sort((a, b) => a - b));
      filter(upward(), [by(from[1]), by(to[1])].sort((a, b) => a - b));
    }, (_, from, to) => {
      if (Math.abs(to[0] - from[0]) + Math.abs(to[1] - from[1]) > 6) return;
      const k = closest(...to);
      if (k >= 0) { marked = k; refresh(); } else { filter(across(), null); filter(upward(), null); }
    });
    canvas.addEventListener("mousemove", (e) => { if (e.buttons) return; const k = closest(...spot(e)); tell(e, k < 0 ? null : about(k)); });
    canvas.addEventListener("mouseleave", () => tell(null, null));
    views.push(draw);
    return draw;
  };
  const scale = (parent, size, c, upright) => {  // the ticks of a row or column of scatters
    const { canvas, pen } = canvasOf(parent, size[0], size[1]), marks = marksOf(c, FEW);
    canvas.className = "ticks";
    canvas.setAttribute("aria-label", `${c.name}: ${marks.map(([, word]) => word).join(", ")}`);
    pen.fillStyle = INK; pen.font = "10px system-ui, sans-serif"; pen.textAlign = upright ? "right" : "center";
    const room = upright ? size[0] - 4 : size[0] / marks.length;
    const draw = () => {
      pen.clearRect(0, 0, size[0], size[1]);
      pen.fillStyle = INK;
      for (const [v, word] of marks) {
        const part = (v - c.low) / (c.high - c.low || 1);
        if (upright) pen.fillText(word, size[0] - 2, size[1] - PAD - part * (size[1] - 2 * PAD) + 3, room);
        else pen.fillText(word, PAD + part * (size[0] - 2 * PAD), 11, room);
      }
    };
    draw();
    views.push(draw);
  };
  const matrix = (parent) => {
    const grid = html("div", parent, null, "matrix"), n = crossed.length, edge = 44;
    const side = Math.floor(((narrow ? room : 1100) - edge) / n), high = Math.round(side * 0.72);
    grid.id = "matrix";
    grid.style.gridTemplateColumns = `minmax(0, ${edge}fr) repeat(${n}, minmax(0, ${side}fr))`;
    for (let i = 0; i < n; i++) {
      scale(html("div", grid), [edge, high], columns[crossed[i]], true);
      for (let j = 0; j < n; j++) {
        const cell = html("div", grid);
        if (i === j) html("b", cell, columns[crossed[i]].name + (columns[crossed[i]].unit ? ` [${columns[crossed[i]].unit}]` : ""));
        else scatter(cell, [side, high], () => crossed[j], () => crossed[i], {});
      }
    }
    html("div", grid);
    for (let j = 0; j < n; j++) scale(html("div", grid), [side, 16], columns[crossed[j]], false);
  };

  // ------------------------------------------------------------------------------------------------ controls, lists
  const picker = (parent, words, get, set) => {
    const label = html("label", parent, `${words} `), select = html("select", label);
    columns.forEach((c, index) => { const option = html("option", select, c.name); option.value = index; option.selected = index === get(); });
    select.onchange = () => { set(Number(select.value)); refresh(); };
    return select;
  };
  const controls = (parent) => {
    const line = html("div", parent, null, "controls");
    const tally = html("b", line, "");
    tally.id = "tally";
    views.push(() => { tally.textContent = `${kept} of ${count} variants`; });
    const told = html("p", parent, null, "print");
    views.push(() => {
      const ends = (c, [low, high]) => [[low, "at least"], [high, "at most"]].filter(([v]) => Number.isFinite(v)).map(([v, words]) => `${words} ${plain(v)}${c.unit ? " " + c.unit : ""}`).join(" and ");
      const kinds = (c, [low, high]) => c.words.filter((_, n) => n >= low && n <= high).join(" or ");
      const held = [...filters].map(([index, range]) => `${columns[index].name} ${columns[index].words ? kinds(columns[index], range) : ends(columns[index], range)}`);
      told.textContent = held.length ? `Kept: ${held.join("; ")}. Red dots are on their Pareto front.` : "All are kept. Red dots are on their Pareto front.";
    });
    const clear = html("button", line, "clear all");
    clear.id = "clear";
    clear.onclick = () => { filters.clear(); marked = -1; refresh(); };
    picker(line, "color by", () => tinted, tint);
    const save = html("button", line, "save the chosen as CSV");
    save.onclick = () => {
      const head = ["variant", ...columns.map((c) => c.name + (c.unit ? ` [${c.unit}]` : ""))], lines = [head];
      for (let k = 0; k < count; k++) if (mask[k]) lines.push([rows.variant[k], ...columns.map((c) => (c.words ? c.words[c.values[k]] : c.values[k]))]);
      const link = html("a", null);
      link.href = URL.createObjectURL(new Blob([lines.map((l) => l.map((v) => (typeof v === "string" && /[",]/.test(v) ? `"${v.replaceAll('"', '""')}"` : v ?? "")).join(",")).join("\n")], { type: "text/csv" }));
      link.download = "variants.csv";
      link.click();
    };
    const axes = html("details", parent), list = html("div", (html("summary", axes, "axes and limits"), axes), null, "limits");
    columns.forEach((c, index) => {
      const row = html("div", list), box = html("input", row);
      box.type = "checkbox"; box.checked = chosenColumns.has(index);
      box.onchange = () => { if (box.checked) chosenColumns.add(index); else chosenColumns.delete(index); refresh(); };
      html("span", row, c.name + (c.unit ? ` [${c.unit}]` : ""));
      if (c.words) return;
      const ends = ["at least", "at most"].map((words) => { const input = html("input", html("label", row, `${words} `)); input.type = "number"; input.step = "any"; input.dataset.column = c.name; input.dataset.end = words; return input; });
      const read = () => { const [a, b] = ends.map((input) => (input.value === "" ? null : Number(input.value))); filter(index, a === null && b === null ? null : [a ?? -Infinity, b ?? Infinity]); };
      for (const input of ends) input.onchange = read;
      views.push(() => { const range = filters.get(index); ends.forEach((input, n) => { if (document.activeElement !== input) input.value = range && Number.isFinite(range[n]) ? Number(range[n].toPrecision(5)) : ""; }); });
    });
    axes.open = rows.limits.length > 0;
    for (const [index, low, high] of rows.limits) filters.set(index, [low ?? -Infinity, high ?? Infinity]);
  };
  const listing = (parent) => {
    const box = html("div", parent, null, "wide"), table = html("table", box);
    table.id = "chosen";
    let most = FIRST;
    const more = html("button", parent, "show more");
    more.id = "more";
    more.onclick = () => { most += 50; refresh(); };
    views.push(() => {
      const shown = [...chosenColumns].sort((a, b) => a - b), order = [];
      for (let k = 0; k < count; k++) if (mask[k]) order.push(k);
      const [index, sign] = rows.objectives[0] || [shown[0], 1];
      const rank = (k) => (front[k] ? 0 : 1);
      order.sort((a, b) => rank(a) - rank(b) || sign * (columns[index].values[a] - columns[index].values[b]) || a - b);
      if (marked >= 0) { order.splice(0, 0, ...order.splice(order.indexOf(marked) < 0 ? order.length : order.indexOf(marked), 1)); if (order[0] !== marked) order.unshift(marked); }
      table.replaceChildren();
      const head = html("tr", html("thead", table));
      for (const word of ["variant", "front", "play it", ...shown.map((i) => columns[i].name + (columns[i].unit ? ` [${columns[i].unit}]` : ""))]) {
        const cell = html("th", head, null, word === "play it" ? "play" : "");
        word.split(/(?<=[._])/).forEach((part, n) => { if (n) html("wbr", cell); cell.append(part); });
      }
      for (const k of order.slice(0, most)) {
        const line = html("tr", table, null, k === marked ? "marked" : "");
        html("td", line, rows.variant[k], "n"); html("td", line, front[k] ? "●" : "");
        const cell = html("td", line, null, "play"), words = command(k);
        if (words) { html("code", cell, `${words} `); copier(cell, words); }
        for (const i of shown) html("td", line, columns[i].words ? columns[i].words[columns[i].values[k]] ?? "–" : written(columns[i], columns[i].values[k]), "n");
        line.onclick = (e) => { if (e.target.tagName !== "BUTTON" && !String(window.getSelection())) { marked = k; refresh(); } };
      }
      more.hidden = order.length <= most;
      named(table);
      if (!more.hidden) html("caption", table, `the first ${most} of ${order.length}, those on the front first`);
    });
  };

  const home = document.getElementById("work");
  controls(home);
  parallel(home);
  if (rows.objectives.length > 1) {
    const place = document.getElementById("front-view");
    if (place) {
      let [a, b] = rows.objectives.map(([index]) => index);
      const line = html("div", place, null, "controls");
      picker(line, "across", () => a, (index) => { a = index; });
      picker(line, "up", () => b, (index) => { b = index; });
      scatter(place, narrow ? [room, 300] : [1100, 430], () => a, () => b, { edge: true, front: true, id: "front-scatter" });
    }
  }
  html("h3", home, "Scatter matrix");
  matrix(home);
  html("h3", home, "The chosen variants");
  if (rows.folder) html("p", home, `Play one: warpchain study play ${rows.folder} VARIANT`, "print lead");
  listing(home);
  playable();
  for (const table of document.querySelectorAll("table:not(#chosen)")) named(table);
  choose();
  for (const view of views) view();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { theme(); refresh(); });
  window.warpchain = { kept: () => kept, marked: () => (marked < 0 ? null : rows.variant[marked]), filters: () => Object.fromEntries([...filters].map(([i, r]) => [columns[i].name, r])), front: () => front.reduce((s, v) => s + v, 0) };
})();
