"use strict";

/* The replay of a report: one drive at one tick, as two maps and a plot of its speed. The data are
   JSON in the element #data; `benchmarks/report/replay_data.py` describes them. */

const TO_SEE = { near: 12, wide: 18 }; // Side of the map around the car [m].
const data = JSON.parse(document.getElementById("data").textContent);
const part = (id) => document.getElementById(id);
const colours = data.colours;

/** Return numbers that were packed as little-endian bytes, zlib, and base64. */
async function unpack(text, Numbers) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Numbers(await new Response(stream).arrayBuffer());
}

/** Return red, green and blue of a colour such as "#A6CEE3". */
const rgb = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
const [FREE, OCCUPIED, UNKNOWN, LIKELY_FREE, LIKELY_OCCUPIED] = [
  "free", "occupied", "unknown", "likely_free", "likely_occupied",
].map((name) => rgb(colours[name]));

/** Unpack a drive once. */
async function load(drive) {
  if (drive.states instanceof Int32Array) return drive;
  const episode = data.episodes.find((each) => each.index === drive.index);
  if (typeof episode.cells === "string") episode.cells = await unpack(episode.cells, Int8Array);
  const kinds = {
    first_seen: Uint16Array, limits: Uint8Array, plans: Int16Array, last_resorts: Int16Array,
    relied: Uint16Array, relied_counts: Uint16Array, beliefs: Int8Array,
    belief_corners: Int32Array, states: Int32Array,
  };
  for (const [name, Numbers] of Object.entries(kinds)) {
    if (typeof drive[name] === "string") drive[name] = await unpack(drive[name], Numbers);
  }
  drive.relied_starts = [0];
  for (const count of drive.relied_counts) {
    drive.relied_starts.push(drive.relied_starts.at(-1) + count);
  }
  drive.episode = episode;
  return drive;
}

/** Return x, y [m], yaw [rad] and v [m/s] at the start of a tick, or at the end of the drive. */
function stateAt(drive, tick) {
  const [x, y, yaw, v] = drive.states.subarray(4 * tick, 4 * tick + 4);
  return { x: x / 1e3, y: y / 1e3, yaw: yaw / 1e4, v: v / 1e3 };
}

/** Return the points [m] of a tick's plan or last resort; none at the end of a drive. */
function motionAt(drive, name, tick) {
  if (!drive[name] || tick === drive.limits.length) return [];
  const size = drive[name].length / drive.limits.length;
  const { x, y } = stateAt(drive, tick), points = [];
  for (let at = size * tick; at < size * (tick + 1); at += 2) {
    points.push([x + drive[name][at] / 100, y + drive[name][at + 1] / 100]);
  }
  return points;
}

/** Return the belief in a tick, from -certain to certain, as a function of row and column. */
function beliefAt(drive, tick) {
  if (!drive.beliefs) return () => 0;
  const [rows, cols] = drive.belief_shape, start = tick * rows * cols;
  const [top, left] = drive.belief_corners.subarray(2 * tick, 2 * tick + 2);
  const cell = drive.episode.factor, block = data.block;
  return (row, col) => {
    const r = Math.floor(((row + 0.5) * cell - top) / block);
    const c = Math.floor(((col + 0.5) * cell - left) / block);
    const inside = r >= 0 && r < rows && c >= 0 && c < cols;
    return inside ? drive.beliefs[start + r * cols + c] : 0;
  };
}

/** Return the colour of an unobserved cell. */
function shade(belief, wall) {
  const share = Math.abs(belief) / data.certain;
  const target = belief < 0 ? LIKELY_OCCUPIED : LIKELY_FREE;
  const mixed = UNKNOWN.map((from, i) => from + (target[i] - from) * share);
  // The true walls, which the car does not know, are a little darker.
  return wall ? mixed.map((value) => 0.8 * value) : mixed;
}

/** Return a colour as the bytes of a pixel. */
const pixel = (colour) => new Uint32Array(Uint8ClampedArray.of(...colour, 255).buffer)[0];
const beliefs = Array.from({ length: 2 * data.certain + 1 }, (_, i) => i - data.certain);
const [WHITE, BLACK, GREY] = [FREE, OCCUPIED, UNKNOWN].map(pixel);
const SHADES = beliefs.map((belief) => pixel(shade(belief, false)));
const WALL_SHADES = beliefs.map((belief) => pixel(shade(belief, true)));

/** Paint what is known and believed in a tick, one pixel for each cell; rows run upwards. */
function paintMap(drive, tick, canvas) {
  const { shape: [rows, cols], cells } = drive.episode, first = drive.first_seen;
  [canvas.width, canvas.height] = [cols, rows];
  const pen = canvas.getContext("2d"), image = pen.createImageData(cols, rows);
  const belief = beliefAt(drive, tick), pixels = new Uint32Array(image.data.buffer);
  for (let row = 0, at = 0; row < rows; row++) {
    for (let col = 0; col < cols; col++, at++) {
      const cell = cells[at];
      if (first[at] > 0 && first[at] <= tick + 1) {
        pixels[at] = cell === 0 ? WHITE : cell === 100 ? BLACK : GREY;
      } else {
        pixels[at] = (cell === 100 ? WALL_SHADES : SHADES)[belief(row, col) + data.certain];
      }
    }
  }
  pen.putImageData(image, 0, 0);
  pen.fillStyle = colours.relied;
  for (let k = drive.relied_starts[tick]; k < drive.relied_starts[tick + 1]; k++) {
    pen.fillRect(drive.relied[2 * k + 1], drive.relied[2 * k], 1, 1);
  }
}

/** Fit a canvas to its place on the page, and return its pen, cleared, in CSS pixels. */
function penOf(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(height * scale)];
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.imageSmoothingEnabled = false;
  return { pen, width, height };
}

function line(pen, points, colour, width, dash = []) {
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  [pen.strokeStyle, pen.lineWidth, pen.lineCap, pen.lineJoin] = [colour, width, "round", "round"];
  pen.setLineDash(dash);
  pen.stroke();
  pen.setLineDash([]);
}

function dot(pen, [x, y], colour, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  [pen.fillStyle, pen.strokeStyle, pen.lineWidth] = [colour, "white", 1];
  pen.fill();
  pen.stroke();
}

/** Draw the map on a canvas; `box` is the shown part: lower left corner x, y and size [m]. */
function drawMap(canvas, map, drive, tick, box) {
  const { pen, width, height } = penOf(canvas);
  const { origin, cell, shape: [rows, cols], goal } = drive.episode;
  const scale = Math.min(width / box.width, height / box.height); // Pixels per metre.
  const at = ([x, y]) => [(x - box.x) * scale, height - (y - box.y) * scale];
  pen.fillStyle = colours.unknown;
  pen.fillRect(0, 0, width, height);
  const [left, bottom] = at(origin);
  pen.save();
  pen.translate(left, bottom);
  pen.scale(1, -1);
  pen.drawImage(map, 0, 0, cols * cell * scale, rows * cell * scale);
  pen.restore();
  const now = stateAt(drive, tick), arm = data.arms[drive.arm];
  const driven = [];
  for (let k = 0; k <= tick; k++) driven.push(at([stateAt(drive, k).x, stateAt(drive, k).y]));
  line(pen, driven, arm, 2);
  const half = data.window / 2;
  const square = [[-half, -half], [half, -half], [half, half], [-half, half], [-half, -half]];
  line(pen, square.map(([x, y]) => at([now.x + x, now.y + y])), colours.ink, 1, [4, 3]);
  dot(pen, at(goal), colours.goal, 6);
  const plan = motionAt(drive, "plans", tick).map(at);
  line(pen, plan, "white", 5);
  line(pen, plan, colours.plan, 2.5);
  line(pen, motionAt(drive, "last_resorts", tick).map(at), colours.last_resort, 2, [1, 4]);
  const [ahead, aside] = data.body.map((side) => side / 2);
  const corners = [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([a, b]) => at([
    now.x + a * ahead * Math.cos(now.yaw) - b * aside * Math.sin(now.yaw),
    now.y + a * ahead * Math.sin(now.yaw) + b * aside * Math.cos(now.yaw),
  ]));
  pen.beginPath();
  corners.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.closePath();
  [pen.fillStyle, pen.strokeStyle, pen.lineWidth] = [arm, "white", 1];
  pen.fill();
  pen.stroke();
}

/** Draw the speed over time, and a strip of what limited it; a vertical line is the present. */
function drawSpeed(canvas, drive, tick) {
  const { pen, width, height } = penOf(canvas);
  const ticks = drive.limits.length, [left, strip, foot] = [34, 14, 18];
  const across = (k) => left + ((width - left - 4) * k) / ticks;
  let [low, high] = [0, data.v_max];
  for (let k = 0; k <= ticks; k++) low = Math.min(low, stateAt(drive, k).v);
  const tall = height - strip - foot - 8;
  const up = (v) => 4 + tall * (1 - (v - low) / (high - low));
  [pen.font, pen.fillStyle, pen.textAlign] = ["11px system-ui, sans-serif", colours.ink, "right"];
  for (const v of [0, high / 2, high]) {
    pen.fillText(v.toFixed(1), left - 4, up(v) + 4);
    line(pen, [[left, up(v)], [width - 4, up(v)]], "#E5E5E5", 1);
  }
  pen.textAlign = "center";
  const every = [1, 2, 5, 10, 20, 50, 100].find((s) => (s / data.dt / ticks) * width > 50) || 200;
  for (let s = 0; s <= ticks * data.dt; s += every) {
    const x = Math.min(Math.max(left + 8, across(s / data.dt)), width - 12);
    pen.fillText(`${s} s`, x, height - 4);
  }
  for (let k = 0; k < ticks; k++) {
    pen.fillStyle = colours.limits[drive.limit_names[drive.limits[k]]] || "#FFFFFF";
    pen.fillRect(across(k), height - foot - strip, across(k + 1) - across(k) + 0.5, strip);
  }
  const points = Array.from({ length: ticks + 1 }, (_, k) => [across(k), up(stateAt(drive, k).v)]);
  line(pen, points, "#C8C8C8", 1.5);
  line(pen, points.slice(0, tick + 1), data.arms[drive.arm], 2.5);
  line(pen, [[across(tick), 4], [across(tick), height - foot]], colours.ink, 1);
  return (x) => Math.round(((x - left) / (width - left - 4)) * ticks);
}

/** The part of the page that shows a drive, and what it shows now. */
class Replay {
  constructor() {
    this.map = document.createElement("canvas");
    this.drive = null;
    this.tick = 0;
    this.playing = false;
    for (const { index, building } of data.episodes) {
      part("episode").add(new Option(`${index} · ${building}`, index));
    }
    part("episode").onchange = () => this.show(Number(part("episode").value), this.drive.arm, 0);
    part("arm").onchange = () => this.show(this.drive.index, part("arm").value, this.tick);
    part("time").oninput = () => this.goTo(Number(part("time").value));
    part("play").onclick = () => this.play(!this.playing);
    const jump = (event) => {
      if (event.buttons) this.goTo(this.tickAt(event.offsetX));
    };
    part("profile").onpointerdown = part("profile").onpointermove = jump;
    document.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("resize", () => this.draw());
    window.addEventListener("hashchange", () => this.follow());
  }

  /** Show the drive that the address names, as in "#drive=3&arm=known&tick=20", or the first. */
  async follow() {
    const named = new URLSearchParams(location.hash.slice(1));
    const index = named.has("drive") ? Number(named.get("drive")) : data.episodes[0].index;
    await this.show(index, named.get("arm") || data.shown_first, Number(named.get("tick")) || 0);
    if (named.has("drive")) part("replay").scrollIntoView();
  }

  /** Show a drive at a tick; if the arm did not drive there, that of another arm. */
  async show(index, arm, tick) {
    const there = data.drives.filter((drive) => drive.index === index);
    const wanted = there.find((drive) => drive.arm === arm) || there[0];
    if (!wanted) return;
    this.wanted = wanted;
    const drive = await load(wanted);
    if (this.wanted !== drive) return; // Another one was chosen in the meantime.
    this.drive = drive;
    part("arm").replaceChildren(...there.map((each) => new Option(each.arm, each.arm)));
    [part("episode").value, part("arm").value] = [drive.index, drive.arm];
    part("time").max = drive.limits.length;
    const { shape: [rows, cols] } = drive.episode;
    part("far").style.aspectRatio = `${cols} / ${rows}`;
    this.goTo(tick);
  }

  goTo(tick) {
    this.tick = Math.max(0, Math.min(tick, this.drive.limits.length));
    this.draw();
  }

  play(on) {
    this.playing = on;
    part("play").textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (this.tick === this.drive.limits.length) this.goTo(0);
    let [begun, from] = [performance.now(), this.tick], drive = this.drive;
    const step = (now) => {
      if (!this.playing) return;
      const passed = Math.floor(((now - begun) / 1000 / data.dt) * Number(part("rate").value));
      if (drive !== this.drive) [begun, from, drive] = [now, this.tick, this.drive];
      else if (passed > 0) {
        // Whatever moved the slider in the meantime is kept.
        [begun, from] = [now, this.tick];
        this.goTo(from + passed);
      }
      if (this.tick === this.drive.limits.length) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Arrows move by a tick, or by a second with Shift; space plays, while the replay is in view. */
  key(event) {
    const { top, bottom } = part("replay").getBoundingClientRect();
    const middle = window.innerHeight / 2, at = event.target.tagName;
    if (!this.drive || top > middle || bottom < middle || event.ctrlKey || event.altKey) return;
    if (at === "SELECT" || (event.key === " " && ["BUTTON", "A", "SUMMARY"].includes(at))) return;
    const jump = event.shiftKey ? Math.round(1 / data.dt) : 1;
    const moves = {
      ArrowLeft: () => this.goTo(this.tick - jump),
      ArrowRight: () => this.goTo(this.tick + jump),
      Home: () => this.goTo(0),
      End: () => this.goTo(Infinity),
      " ": () => this.play(!this.playing),
    };
    if (!moves[event.key]) return;
    event.preventDefault();
    moves[event.key]();
  }

  draw() {
    if (!this.drive) return;
    const { drive, tick } = this, { origin, cell, shape: [rows, cols] } = drive.episode;
    // At its end, the drive is as the last tick has left it.
    const now = stateAt(drive, tick), decided = Math.min(tick, drive.limits.length - 1);
    const limit = drive.limit_names[drive.limits[decided]];
    const side = data.window > 10 ? TO_SEE.wide : TO_SEE.near;
    paintMap(drive, decided, this.map);
    drawMap(part("near"), this.map, drive, tick, {
      x: now.x - side / 2, y: now.y - side / 2, width: side, height: side,
    });
    drawMap(part("far"), this.map, drive, tick, {
      x: origin[0], y: origin[1], width: cols * cell, height: rows * cell,
    });
    this.tickAt = drawSpeed(part("profile"), drive, tick);
    part("time").value = tick;
    part("time").setAttribute("aria-valuetext", `${(tick * data.dt).toFixed(1)} seconds`);
    part("clock").textContent = `${(tick * data.dt).toFixed(1)} s`;
    part("speed").textContent = `${now.v.toFixed(2)} m/s`;
    part("limit").textContent = limit;
    part("limit").style.borderColor = colours.limits[limit] || "#FFFFFF";
    part("reason").textContent = data.reasons[limit] || "";
    part("outcome").textContent = tick > decided ? drive.outcome : "";
  }
}

if (!data.episodes.length) {
  part("problem").textContent = "No drive of this run is in this file.";
} else if (!("DecompressionStream" in window)) {
  part("problem").textContent =
    "This browser cannot unpack the drives: the replay needs DecompressionStream (Chrome 80, " +
    "Firefox 113, Safari 16.4, or newer).";
} else {
  new Replay().follow();
}
