// Shows the scenes of a report: drag to turn, scroll to zoom, click for values.  DATA is set above.
"use strict";
(async () => {
  const canvas = document.getElementById("view"), box = canvas.parentElement;
  const list = document.getElementById("scenes"), note = document.getElementById("note");
  const bar = document.getElementById("bar"), mark = document.getElementById("mark");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl || !window.DecompressionStream) {
    note.textContent = "This browser cannot draw the mesh: it has no WebGL 2 or no DecompressionStream.";
    return;
  }

  // Arrays are compressed.
  const array = async (Kind, text) => {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Kind(await new Response(stream).arrayBuffer());
  };
  for (const g of DATA.geometries) {
    const steps = await array(Uint16Array, g.points), cells = await array(Uint32Array, g.cells);
    g.corners = new Float32Array(3 * cells.length); // relative to the middle of the box
    cells.forEach((p, k) => {
      for (let d = 0; d < 3; d++) g.corners[3 * k + d] = (steps[3 * p + d] / 65535 - 0.5) * g.size[d];
    });
    g.indices = cells;
    g.middle = g.low.map((x, d) => x + 0.5 * g.size[d]);
  }
  for (const s of DATA.scenes) {
    const values = await array(s.classes ? Uint32Array : Uint8Array, s.values), cells = DATA.geometries[s.geometry].indices;
    s.held = cells.map((p, k) => values[s.on_nodes ? p : (k / 3) | 0]);
    s.shown = Uint8Array.from(s.held, (v) => (s.classes ? v % s.colours.length : v));
    list.append(new Option(s.name));
  }

  const program = gl.createProgram();
  const compile = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  };
  compile(gl.VERTEX_SHADER, `#version 300 es
    in vec3 place; in float value;
    uniform mat4 camera; uniform mat3 turn;
    out vec3 seen; out vec3 corner; out float shade;
    void main() {
      int k = gl_VertexID % 3;
      corner = vec3(k == 0, k == 1, k == 2);
      seen = turn * place; shade = value;
      gl_Position = camera * vec4(place, 1.0);
    }`);
  // Edges of at most a pixel, fainter where the triangles are small.
  compile(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float;
    in vec3 seen; in vec3 corner; in float shade;
    uniform sampler2D colours; uniform float light; uniform bool edges;
    out vec4 colour;
    void main() {
      vec3 c = texture(colours, vec2((shade * 255.0 + 0.5) / 256.0, 0.5)).rgb;
      vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
      c *= 1.0 - light * (1.0 - abs(normal.z));
      vec3 wide = fwidth(corner), far = corner / wide;
      float height = 1.0 / max(wide.x, max(wide.y, wide.z));
      float line = 1.0 - smoothstep(0.2, 1.0, min(far.x, min(far.y, far.z)));
      if (edges) c = mix(c, vec3(0.06, 0.09, 0.16), line * clamp((height - 2.0) / 14.0, 0.0, 0.75));
      colour = vec4(c, 1.0);
    }`);
  gl.linkProgram(program);
  gl.useProgram(program);
  const at = (name) => gl.getUniformLocation(program, name);
  const places = ["camera", "turn", "light", "edges"].reduce((all, n) => ({ ...all, [n]: at(n) }), {});
  const buffers = ["place", "value"].map((name, k) => {
    const buffer = gl.createBuffer(), where = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(where);
    if (k) gl.vertexAttribPointer(where, 1, gl.UNSIGNED_BYTE, true, 0, 0);
    else gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 0, 0);
    return buffer;
  });
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.enable(gl.DEPTH_TEST);

  let scene, geometry, marked = null, chosen = false; // whether a reader has chosen the view
  const from = DATA.seen_from || [0.75, -1, 0.8]; // the direction in which the viewer is at first
  const view = { turn: Math.atan2(from[1], from[0]), rise: Math.asin(from[2] / Math.hypot(...from)) };
  Object.assign(view, { focus: [0, 0, 0], tall: 1 });
  const axes = () => {
    if (geometry.flat) return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const [c, s, d, e] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.rise), Math.sin(view.rise)];
    return [[-s, c, 0], [-c * e, -s * e, d], [c * d, s * d, e]];
  };
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  function fit() {
    chosen = false;
    const [right, up] = axes(), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let k = 0; k < geometry.corners.length; k += 3) {
      const p = geometry.corners.subarray(k, k + 3);
      [dot(right, p), dot(up, p)].forEach((x, d) => {
        low[d] = Math.min(low[d], x);
        high[d] = Math.max(high[d], x);
      });
    }
    const aspect = canvas.clientWidth / canvas.clientHeight;
    view.tall = 1.06 * Math.max(high[1] - low[1], (high[0] - low[0]) / aspect) || 1;
    view.focus = right.map((r, d) => (r * (low[0] + high[0]) + up[d] * (low[1] + high[1])) / 2);
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    gl.viewport(0, 0, canvas.width, canvas.height);
    const turned = axes(), deep = Math.hypot(...geometry.size) * 2 + view.tall;
    const scale = [2 / (view.tall * (width / height)), 2 / view.tall, -1 / deep];
    const camera = new Float32Array(16);
    turned.forEach((axis, row) => {
      axis.forEach((x, column) => (camera[4 * column + row] = x * scale[row]));
      camera[12 + row] = -dot(axis, view.focus) * scale[row];
    });
    camera[15] = 1;
    gl.uniformMatrix4fv(places.camera, false, camera);
    gl.uniformMatrix3fv(places.turn, false, [0, 1, 2].flatMap((c) => turned.map((axis) => axis[c])));
    gl.uniform1f(places.light, geometry.flat ? 0 : scene.classes ? 0.45 : 0.25);
    gl.uniform1i(places.edges, document.getElementById("edges").checked);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.TRIANGLES, 0, geometry.indices.length);
    mark.hidden = !marked;
    if (marked) {
      const [x, y] = pixel(marked.map((p, d) => p - geometry.middle[d]));
      mark.style.transform = `translate(${x}px, ${y}px)`;
    }
  }
  const frame = () => requestAnimationFrame(draw);

  // Where a point is in the box, in pixels; what moves by a pixel.
  const unit = () => view.tall / canvas.clientHeight;
  function pixel(p) {
    const [right, up] = axes(), off = p.map((x, d) => x - view.focus[d]);
    return [canvas.clientWidth / 2 + dot(right, off) / unit(), canvas.clientHeight / 2 - dot(up, off) / unit()];
  }
  function pan(x, y) {
    const [right, up] = axes();
    view.focus = view.focus.map((f, d) => f - right[d] * x * unit() + up[d] * y * unit());
  }
  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    const [dx, dy] = [x - canvas.clientWidth / 2, y - canvas.clientHeight / 2];
    pan(-dx, -dy);
    view.tall *= factor;
    pan(dx, dy);
  }
  function rotate(x, y) {
    if (geometry.flat) return pan(x, y);
    view.turn -= x * 0.008;
    view.rise = Math.max(-1.57, Math.min(1.57, view.rise + y * 0.008));
  }

  function choose(number) {
    const before = geometry;
    scene = DATA.scenes[number];
    geometry = DATA.geometries[scene.geometry];
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
    gl.bufferData(gl.ARRAY_BUFFER, geometry.corners, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[1]);
    gl.bufferData(gl.ARRAY_BUFFER, scene.shown, gl.STATIC_DRAW);
    const colours = scene.colours.map((c) => [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16)));
    const texture = new Uint8Array(4 * 256);
    for (let k = 0; k < 256; k++) {
      const t = scene.classes ? k % colours.length : (k / 255) * (colours.length - 1);
      const a = colours[Math.floor(t)], b = colours[Math.ceil(t)];
      texture.set([...a.map((x, d) => x + (b[d] - x) * (t % 1)), 255], 4 * k);
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, texture);
    bar.replaceChildren(Object.assign(document.createElement("b"), { textContent: scene.label }));
    bar.className = scene.classes ? "classes" : "range";
    const strip = bar.appendChild(document.createElement("div"));
    if (!scene.classes) strip.style.background = `linear-gradient(to top, ${scene.colours})`;
    for (const [where, text] of scene.ticks) {
      const tick = Object.assign(document.createElement("span"), { textContent: text });
      if (scene.classes) tick.style.setProperty("--colour", scene.colours[where % scene.colours.length]);
      else tick.style.bottom = `${100 * where}%`;
      strip.append(tick);
    }
    if (!before) fit();
    else if (before !== geometry) view.focus = view.focus.map((f, d) => f + before.middle[d] - geometry.middle[d]);
    frame();
  }

  // The triangle under a place of the box: the nearest one to the viewer whose projection has it.
  function pick(x, y) {
    const [right, up, eye] = axes();
    const u = dot(right, view.focus) + (x - canvas.clientWidth / 2) * unit();
    const v = dot(up, view.focus) - (y - canvas.clientHeight / 2) * unit();
    let best = null, nearest = -Infinity;
    for (let k = 0; k < geometry.corners.length; k += 9) {
      const c = [0, 3, 6].map((i) => geometry.corners.subarray(k + i, k + i + 3));
      const [a, b, d] = c.map((p) => [dot(right, p) - u, dot(up, p) - v]);
      const w = [b[0] * d[1] - d[0] * b[1], d[0] * a[1] - a[0] * d[1], a[0] * b[1] - b[0] * a[1]];
      const sum = w[0] + w[1] + w[2];
      if (!sum || w.some((part) => part / sum < 0)) continue;
      const point = [0, 1, 2].map((i) => (w[0] * c[0][i] + w[1] * c[1][i] + w[2] * c[2][i]) / sum);
      if (dot(eye, point) > nearest) {
        nearest = dot(eye, point);
        const value = w.reduce((total, part, i) => total + (part / sum) * scene.held[k / 3 + i], 0);
        best = { point: point.map((p, i) => p + geometry.middle[i]), value };
      }
    }
    return best;
  }
  function tell(x, y) {
    const found = pick(x, y);
    marked = found && found.point;
    note.textContent = "";
    if (found) {
      const { low, high, logarithmic } = scene, t = found.value / 255;
      const value = scene.classes ? scene.ticks[Math.round(found.value)]?.[1]
        : (logarithmic ? low * (high / low) ** t : low + (high - low) * t).toPrecision(3);
      const place = found.point.slice(0, geometry.flat ? 2 : 3).map((p) => p.toPrecision(5));
      note.textContent = `${scene.label} ${value} at (${place.join(", ")})`;
    }
    frame();
  }

  const fingers = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, [e.offsetX, e.offsetY]);
    moved = 0;
  });
  canvas.addEventListener("pointermove", (e) => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    chosen = true;
    const [x, y] = [e.offsetX - before[0], e.offsetY - before[1]];
    const other = [...fingers.entries()].find(([id]) => id !== e.pointerId)?.[1];
    moved += Math.abs(x) + Math.abs(y);
    if (other) {
      const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) + 1;
      zoom(far(before) / far([e.offsetX, e.offsetY]));
      pan(x / 2, y / 2);
    } else if (e.shiftKey || e.buttons === 2) pan(x, y);
    else rotate(x, y);
    fingers.set(e.pointerId, [e.offsetX, e.offsetY]);
    frame();
  });
  const lift = (e) => {
    if (fingers.delete(e.pointerId) && moved < 4 && e.type === "pointerup") tell(e.offsetX, e.offsetY);
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    chosen = true;
    zoom(1.0015 ** e.deltaY, e.offsetX, e.offsetY);
    frame();
  }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const move = { ArrowLeft: [-24, 0], ArrowRight: [24, 0], ArrowUp: [0, -24], ArrowDown: [0, 24] }[e.key];
    if (move) (e.shiftKey ? pan : rotate)(...move);
    else if ("+-".includes(e.key)) zoom(e.key === "+" ? 0.8 : 1.25);
    else return;
    chosen = true;
    e.preventDefault();
    frame();
  });
  for (const button of document.querySelectorAll("button[data-at]"))
    button.addEventListener("click", () => {
      marked = JSON.parse(button.dataset.at);
      chosen = true;
      while (marked.length < 3) marked.push(0);
      view.focus = marked.map((p, d) => p - geometry.middle[d]);
      view.tall = Math.min(view.tall, 0.12 * Math.hypot(...geometry.size));
      note.textContent = button.closest("tr").lastElementChild.textContent;
      box.scrollIntoView({ behavior: "smooth", block: "center" });
      frame();
    });
  document.getElementById("whole").addEventListener("click", () => {
    marked = null;
    fit();
    frame();
  });
  document.getElementById("edges").addEventListener("change", frame);
  list.addEventListener("change", () => choose(list.selectedIndex));
  choose(0);
  new ResizeObserver(() => {
    if (!chosen) fit();
    frame();
  }).observe(box);
})();
