"use strict";
(async () => {
  const MOST_BINS = 900; // in view; more could not be seen
  const WIDE_BINS = 250; // in view; fewer are wide enough to be seen as points
  const LEFT = 170; // px, where the charts begin
  const INK = "#202124", QUIET = "#5f6368", LINE = "#e3e5e8";

  // Unpack series: see series.py.
  async function unpack(packed) {
    const raw = Uint8Array.from(atob(packed.bytes), (c) => c.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    let at = 0;
    return packed.heads.map((head) => {
      const out = new Float64Array(head.n).fill(NaN);
      let mask = null;
      if (head.known < head.n) {
        const length = Math.ceil(head.n / 8);
        mask = bytes.subarray(at, at + length);
        at += length;
      }
      let number = 0, k = 0;
      for (let i = 0; i < head.n; i++) {
        if (mask && !((mask[i >> 3] >> (i & 7)) & 1)) continue;
        let code = 0, unit = 1;
        for (let plane = 0; plane < head.planes; plane++, unit *= 256) code += bytes[at + plane * head.known + k] * unit;
        number += code % 2 ? -(code + 1) / 2 : code / 2;
        out[i] = head.log ? head.log[1] * Math.pow(head.log[0], number) : number * head.step;
        k++;
      }
      at += head.planes * head.known;
      return out;
    });
  }

  const least = (a, b) => (isNaN(a) ? b : isNaN(b) ? a : Math.min(a, b));
  const most = (a, b) => (isNaN(a) ? b : isNaN(b) ? a : Math.max(a, b));

  function halved(values, pick) {
    const out = new Float64Array(Math.ceil(values.length / 2));
    for (let i = 0; i < out.length; i++) out[i] = pick(values[2 * i], 2 * i + 1 < values.length ? values[2 * i + 1] : NaN);
    return out;
  }

  // Levels of one quantity, from the finest to one that fits into any view.
  function pyramid(lo, hi, std) {
    const levels = [{ lo, hi, std }];
    while (levels[levels.length - 1].lo.length > MOST_BINS / 2) {
      const last = levels[levels.length - 1];
      levels.push({ lo: halved(last.lo, least), hi: halved(last.hi, most), std: last.std && halved(last.std, most) });
    }
    return levels;
  }

  function times(t) {
    const levels = [t];
    while (levels[levels.length - 1].length > MOST_BINS / 2) levels.push(halved(levels[levels.length - 1], (a) => a));
    return levels;
  }

  function after(t, value) {
    let low = 0, high = t.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (t[middle] <= value) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Table [x, middle, upper, lower] of a quantity in view, for uPlot.
  function table(result, levels, view, lag) {
    const empty = [[view[0]], [null], [null], [null]];
    if (!levels) return empty;
    let level = 0, first = 0, stop = 0;
    for (; ; level++) {
      const t = result.times[level];
      first = Math.max(after(t, view[0] + lag) - 2, 0);
      stop = Math.min(after(t, view[1] + lag) + 1, t.length);
      if (stop - first <= MOST_BINS || level === result.times.length - 1) break;
    }
    const t = result.times[level], { lo, hi, std } = levels[level];
    // A bin of some pixels is a point with a band from its smallest to its largest value, a narrow one a line between them.
    const exact = result.width === 1 && level === 0;
    const bin = exact ? 0 : (t[t.length - 1] - t[0]) / Math.max(t.length - 1, 1), single = exact || stop - first < WIDE_BINS;
    const half = bin / 2;
    const x = [], middle = [], upper = [], lower = [];
    for (let i = first; i < stop; i++) {
      const known = !isNaN(lo[i]), wide = std && !isNaN(std[i]) ? std[i] : NaN;
      for (let side = 0; side < (single ? 1 : 2); side++) {
        x.push(t[i] - lag + (single ? half : side * half));
        middle.push(known ? (single ? (lo[i] + hi[i]) / 2 : side ? hi[i] : lo[i]) : null);
        upper.push(known && !isNaN(wide) ? hi[i] + wide : null);
        lower.push(known && !isNaN(wide) ? lo[i] - wide : null);
      }
    }
    return x.length ? [x, middle, upper, lower] : empty;
  }

  const shade = (colour, alpha) => colour + Math.round(255 * alpha).toString(16).padStart(2, "0");

  function axis(label, size) {
    return { label, labelSize: label ? 18 : 0, size, stroke: QUIET, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", grid: { stroke: LINE, width: 1 }, ticks: { show: false } };
  }

  function element(name, attributes, parent) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (parent) parent.appendChild(made);
    return made;
  }

  // Taxels of the hand with a shade from 0 to 99 each; -1: masked.
  function handPicture(hand, box, shades, width) {
    const [left, right, low, high] = box;
    const svg = element("svg", { viewBox: `${left} ${-high} ${right - left} ${high - low}`, width, height: Math.round((width * (high - low)) / (right - left)) });
    hand.outlines.forEach((outline, k) => {
      const part = Math.max(shades[k], 0) / 99;
      const mix = (from, to) => Math.round(from + (to - from) * part);
      element("polygon", {
        points: outline.map(([x, y]) => `${x},${-y}`).join(" "),
        fill: shades[k] < 0 ? "#fff" : `rgb(${mix(240, 8)},${mix(243, 64)},${mix(246, 129)})`,
        stroke: "#d5d9dd", "stroke-width": 0.3,
      }, svg);
    });
    return svg;
  }

  function arrow(svg, [x, y, dx, dy, colour], width) {
    const length = Math.hypot(dx, dy);
    if (length > 0) {
      const head = Math.min(0.03 * width, length), ux = dx / length, uy = dy / length;
      const tip = [x + dx, y + dy], neck = [tip[0] - head * ux, tip[1] - head * uy];
      element("line", { x1: x, y1: -y, x2: neck[0], y2: -neck[1], stroke: colour, "stroke-width": 0.009 * width }, svg);
      const corners = [tip, [neck[0] - 0.45 * head * uy, neck[1] + 0.45 * head * ux], [neck[0] + 0.45 * head * uy, neck[1] - 0.45 * head * ux]];
      element("polygon", { points: corners.map((c) => `${c[0]},${-c[1]}`).join(" "), fill: colour }, svg);
    }
    element("circle", { cx: x, cy: -y, r: 0.008 * width, fill: colour }, svg);
  }

  async function show(section, recording) {
    const results = recording.results;
    for (const result of results) {
      const series = await unpack(result.packed);
      result.times = times(series[result.t]);
      result.levels = {};
      for (const pad in result.tracks) {
        result.levels[pad] = {};
        for (const name of ["x", "y", "theta", "load"]) {
          const found = result.tracks[pad][name];
          if (found) result.levels[pad][name] = pyramid(series[found.lo], series[found.hi], found.std === undefined ? null : series[found.std]);
        }
      }
    }
    const pick = (selector) => section.querySelector(selector);
    const whole = [0, Math.max(recording.duration_s, 1e-3)];
    let view = whole.slice(), pad = recording.pads[0];
    const charts = [];
    const measured = results.filter((result) => !result.truth);

    function setView(from, to) {
      const width = Math.min(Math.max(to - from, 1e-3), whole[1] - whole[0]);
      const start = Math.min(Math.max(from, whole[0]), whole[1] - width);
      view = [start, start + width];
      pick(".range").textContent = `${view[0].toFixed(2)} to ${view[1].toFixed(2)} s`;
      for (const chart of charts) chart.draw();
    }

    function options(own, height, label) {
      return Object.assign({
        width: section.clientWidth, height, legend: { show: false }, padding: [8, 12, 0, LEFT - 76],
        cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, sync: { key: `recording-${section.dataset.number}` }, bind: { dblclick: () => () => { setView(...whole); return null; } } },
        axes: [axis(own.last ? "time in s" : "", 30), axis(label, 58)],
      }, own, {
        hooks: Object.assign({
          setSelect: [(u) => {
            if (u.select.width < 3) return;
            const from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
            u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
            setView(from, to);
          }],
        }, own.hooks || {}),
      });
    }

    // Contacts and slips: a lane for each pad and result.
    const lanes = [];
    for (const name of recording.pads) for (const result of results) if (result.lanes[name]) lanes.push([name, result]);
    const lanesHeight = Math.min(17 * lanes.length, 640) + 60;
    function drawLanes(u) {
      const { ctx } = u, thick = Math.abs(u.valToPos(1, "y", true) - u.valToPos(0, "y", true));
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      lanes.forEach(([name, result], k) => {
        const middle = u.valToPos(k, "y", true);
        if (name === pad) {
          ctx.fillStyle = "#f1f3f4";
          ctx.fillRect(u.bbox.left, middle - thick / 2, u.bbox.width, thick);
        }
        for (const [kind, share, alpha] of [["contact", 0.42, 0.3], ["slip", 0.74, 1]]) {
          ctx.fillStyle = shade(result.colour, alpha);
          for (const [from, to] of result.lanes[name][kind]) {
            if (to < view[0] || from > view[1]) continue;
            const left = u.valToPos(from, "x", true), right = u.valToPos(to, "x", true);
            ctx.fillRect(left, middle - (share * thick) / 2, Math.max(right - left, 1), share * thick);
          }
        }
        ctx.fillStyle = "#cc2fa0";
        for (const t of result.lanes[name].suspected) {
          const x = u.valToPos(t, "x", true), r = 0.3 * thick;
          ctx.beginPath();
          ctx.moveTo(x - r, middle); ctx.lineTo(x, middle - r); ctx.lineTo(x + r, middle); ctx.lineTo(x, middle + r);
          ctx.fill();
        }
      });
      ctx.restore();
    }
    const names = lanes.map(([name, result]) => (results.length > 1 ? `${name}, ${result.short}` : name));
    const laneAxis = Object.assign(axis("", LEFT), {
      splits: () => lanes.map((_, k) => k), values: (_, splits) => splits.map((k) => names[k]), grid: { show: false }, font: "11px system-ui, sans-serif",
    });
    const laneChart = new uPlot(options({
      series: [{}, { show: false }],
      padding: [8, 12, 0, 0],
      scales: { x: { time: false, range: () => view }, y: { dir: -1, range: [-0.5, lanes.length - 0.5] } },
      axes: [axis("time in s", 30), laneAxis], hooks: { draw: [drawLanes] },
    }, lanesHeight, ""), [whole, [null, null]], pick(".lanes"));
    charts.push({ chart: laneChart, draw: () => laneChart.setData([view, [null, null]]) });
    laneChart.over.addEventListener("click", (event) => {
      const k = Math.round(laneChart.posToVal(event.offsetY, "y"));
      if (lanes[k]) setPad(lanes[k][0]);
    });

    // Trajectories: a chart for each quantity.
    const quantities = [["x", "x in mm", 210, 1], ["y", "y in mm", 210, 1], ["theta", "rotation in deg", 170, 1], ["load", "load in %", 120, 0]];
    for (const [name, label, height, banded] of quantities) {
      const shown = name === "load" ? measured.slice(0, 1) : results;
      const has = () => shown.some((result) => result.levels[pad] && result.levels[pad][name]);
      const series = [{}], bands = [];
      for (const result of shown) {
        const at = series.length;
        const colour = name === "load" ? INK : result.colour;
        series.push({ stroke: colour, width: 1.3, points: { size: 4 } });
        for (let side = 0; side < 2; side++) series.push({ stroke: "transparent", width: 0, points: { show: false }, auto: false });
        if (banded) bands.push({ series: [at + 1, at + 2], fill: shade(colour, 0.18) });
      }
      const holder = pick(`.chart.${name}`);
      const data = () => shown.length ? uPlot.join(shown.map((result) => table(result, (result.levels[pad] || {})[name], view, name === "load" ? 0 : result.lag_s))) : [[]]; // no load where nothing was touched
      const range = (_, low, high) => {
        if (name === "load") return [-4, 106];
        const side = name === "x" ? 0 : 2, extent = recording.extent[pad];
        if (name !== "theta" && extent) { // a position far beyond the pad is not worth the room
          const reach = (extent[side + 1] - extent[side]) / 2;
          low = Math.max(low, Math.min(extent[side] - reach, high - 1));
          high = Math.min(high, Math.max(extent[side + 1] + reach, low + 1));
        }
        const middle = (low + high) / 2 || 0, half = Math.max((high - low) / 2 || 0, name === "theta" ? 2 : 0.5);
        return [middle - 1.12 * half, middle + 1.12 * half];
      };
      const chart = new uPlot(options({ series, bands, scales: { x: { time: false, range: () => view }, y: { range } }, last: name === "load" }, height, label), data(), holder);
      charts.push({ chart, draw: () => {
        holder.style.display = has() ? "" : "none";
        if (has()) chart.setData(data());
      } });
    }

    function setPad(name) {
      pad = name;
      for (const button of section.querySelectorAll(".pads button")) button.classList.toggle("on", button.textContent === name);
      setView(...view);
    }
    for (const name of recording.pads) {
      const button = document.createElement("button");
      button.textContent = name;
      button.onclick = () => setPad(name);
      pick(".pads").appendChild(button);
    }
    for (const result of results) {
      const entry = document.createElement("span"), mark = document.createElement("i");
      mark.style.background = result.colour;
      entry.append(mark, result.label);
      pick(".key").appendChild(entry);
    }
    const moves = { whole: () => whole, out: ([a, b]) => [a - (b - a) / 2, b + (b - a) / 2], left: ([a, b]) => [a - (b - a) / 2, b - (b - a) / 2], right: ([a, b]) => [a + (b - a) / 2, b + (b - a) / 2] };
    for (const button of section.querySelectorAll("[data-do]")) button.onclick = () => setView(...moves[button.dataset.do](view));
    new ResizeObserver(() => {
      for (const { chart } of charts) if (chart.width !== section.clientWidth) chart.setSize({ width: section.clientWidth, height: chart.height });
    }).observe(section);

    // Key scans and the sensor's map.
    const hint = pick(".scans-hint");
    hint.textContent = recording.scans.length ? "Pressure from light (0) to dark (largest of the scan); arrows: slip vectors in the colours of the methods, on one scale. Click a scan to see its time above." : recording.no_scans;
    for (const scan of recording.scans) {
      const figure = document.createElement("figure"), caption = document.createElement("figcaption");
      const svg = handPicture(recording.hand, recording.hand.touched, scan.shades, 340);
      for (const one of scan.arrows) arrow(svg, one, recording.hand.touched[1] - recording.hand.touched[0]);
      caption.textContent = scan.title;
      figure.append(svg, caption);
      figure.onclick = () => {
        pad = scan.pad;
        const width = Math.min(4, whole[1]);
        setView(scan.t_s - width / 2, scan.t_s + width / 2);
        setPad(scan.pad);
        pick(".lanes").scrollIntoView({ behavior: "smooth", block: "center" });
      };
      pick(".scans").appendChild(figure);
    }
    if (recording.health) {
      const figure = document.createElement("figure"), caption = document.createElement("figcaption");
      const svg = handPicture(recording.hand, recording.hand.box, recording.health.shades, 480);
      [...recording.health.marks].forEach((mark, k) => {
        if (!"!xF".includes(mark)) return;
        const points = recording.hand.outlines[k].map(([x, y]) => `${x},${-y}`).join(" ");
        element("polygon", { points, fill: "none", stroke: mark === "x" ? "#9aa0a6" : mark === "F" ? "#cc2fa0" : "#d55e00", "stroke-width": 0.8 }, svg);
      });
      caption.textContent = recording.health.caption;
      caption.style.maxWidth = "480px";
      figure.append(svg, caption);
      pick(".health").appendChild(figure);
    }
    setPad(pad);
  }

  const numbers = JSON.parse(document.getElementById("numbers").textContent);
  for (const section of document.querySelectorAll("section.recording")) await show(section, numbers[Number(section.dataset.number)]);
  document.body.dataset.ready = "yes";
})();
