/* The 3-D scene: points and boxes by WebGL, turned by mouse or fingers. */
"use strict";
(() => {
  const place = document.getElementById("scene-view");
  if (!place) return;
  const at = (id) => document.getElementById(id);
  const canvas = place.querySelector("canvas"), titles = place.querySelector(".titles");
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) {
    place.textContent = "This browser draws nothing in 3-D (WebGL is off).";
    return;
  }
  const scenes = JSON.parse(place.dataset.scenes), TINT = 0.6, TRUTH = [0.1, 0.1, 0.12];
  const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  const words = (text) => new Uint16Array(bytes(text).buffer);

  function program(vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  }
  const points = program(
    `attribute vec3 place; attribute vec3 colour; uniform mat4 view; uniform float unit, size; varying vec3 seen;
     void main() { gl_Position = view * vec4(place * unit, 1.0); seen = colour;
       gl_PointSize = clamp(size / gl_Position.w, 1.5, 40.0); }`,
    "precision mediump float; varying vec3 seen; void main() { gl_FragColor = vec4(seen, 1.0); }");
  // Lines of WebGL are one pixel wide, so each edge is a strip that faces the screen.
  const strips = program(
    `attribute vec3 place, other; attribute float side; attribute vec3 colour; uniform mat4 view; uniform vec2 pixel;
     varying vec3 seen;
     void main() { vec4 here = view * vec4(place, 1.0), there = view * vec4(other, 1.0); seen = colour;
       vec2 along = (there.xy / max(there.w, 0.001) - here.xy / max(here.w, 0.001)) / pixel;
       vec2 across = normalize(vec2(-along.y, along.x) + 1e-6) * side * pixel;
       gl_Position = here + vec4(across * here.w, 0.0, 0.0); }`,
    `precision mediump float; varying vec3 seen; uniform float opacity;
     void main() { gl_FragColor = vec4(seen * opacity, opacity); }`);
  const buffers = Object.fromEntries(["place", "colour", "strips"].map((name) => [name, gl.createBuffer()]));
  let scene, view, turn, numStrips = 0, asked = false;

  const minus = (a, b) => a.map((value, axis) => value - b[axis]);
  const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((value) => value / Math.hypot(...a));

  function open() {
    const one = scenes[Number(at("scene-episode").value) || 0], offset = minus(one.eye, one.target);
    scene = { ...one, places: words(one.points), true: bytes(one.colours), number: words(one.numbers) };
    turn = { target: [...one.target], distance: Math.hypot(...offset), azimuth: Math.atan2(offset[1], offset[0]),
             elevation: Math.asin(offset[2] / Math.hypot(...offset)) };
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.place);
    gl.bufferData(gl.ARRAY_BUFFER, scene.places, gl.STATIC_DRAW);
    paint();
  }

  function wanted(one) {
    const category = at("category").value;
    const sure = one.confidence === undefined || one.confidence >= Number(at("confidence").value);
    return sure && (!category || one.category === category);
  }

  /* Colours of points, boxes and titles, of what confidence and category leave. */
  function paint() {
    if (place.closest("[hidden]") || !scene) return;
    const shown = scene.objects.filter(wanted), colours = Uint8Array.from(scene.true);
    const of = new Map(shown.map((one) => [one.number, one]));
    const tinted = at("scene-colour").value !== "true";
    const hue = (one) => at("scene-colour").value === "confidence"
      ? [Math.min(1, 2 - 2 * one.confidence), Math.min(1, 2 * one.confidence), 0] : one.colour;
    for (let index = 0; tinted && index < scene.count; index++) {
      const one = of.get(scene.number[index]);
      if (!one) continue;
      const [red, green, blue] = hue(one);
      [red, green, blue].forEach((value, channel) => {
        const byte = 3 * index + channel;
        colours[byte] = (1 - TINT) * colours[byte] + TINT * 255 * value;
      });
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.colour);
    gl.bufferData(gl.ARRAY_BUFFER, colours, gl.STATIC_DRAW);
    const corners = [];
    const add = (box, colour) => {
      for (const [a, b] of scene.edges) {
        const from = box.slice(3 * a, 3 * a + 3), to = box.slice(3 * b, 3 * b + 3);
        for (const [end, side] of [[0, -1], [0, 1], [1, 1], [0, 1], [1, 1], [1, -1]]) {
          corners.push(...(end ? [...to, ...from] : [...from, ...to]), side, ...colour);
        }
      }
    };
    if (at("scene-truth").checked) scene.truth.filter(wanted).forEach((one) => add(one.corners, TRUTH));
    if (at("scene-boxes").checked) shown.forEach((one) => add(one.corners, hue(one).map((value) => 0.85 * value)));
    numStrips = corners.length / 10;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.strips);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    titles.replaceChildren(...(at("scene-titles").checked ? shown : []).map((one) => {
      const title = document.createElement("span"), top = Math.max(...[2, 5, 8, 11, 14, 17, 20, 23].map((z) => one.corners[z]));
      const middle = [0, 1].map((axis) => one.corners.filter((_, index) => index % 3 === axis).reduce((a, b) => a + b) / 8);
      title.textContent = one.title;
      title.style.borderColor = `rgb(${hue(one).map((value) => 255 * value)})`;
      title.at = [...middle, top];
      return title;
    }));
    place.dataset.shown = shown.length;
    ask();
  }

  function ask() {
    if (!asked) requestAnimationFrame(draw);
    asked = true;
  }

  function look(width, height) {
    const flat = Math.cos(turn.elevation);
    const back = [flat * Math.cos(turn.azimuth), flat * Math.sin(turn.azimuth), Math.sin(turn.elevation)];
    const eye = turn.target.map((value, axis) => value + turn.distance * back[axis]);
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    // The field of view is that of the shorter side.
    const reach = Math.tan(scene.fov / 2), across = reach * Math.max(1, width / height), high = reach * Math.max(1, height / width);
    const near = 0.02 * turn.distance, far = 20 * turn.distance + 50;
    const rows = [
      [...right.map((value) => value / across), -dot(right, eye) / across],
      [...up.map((value) => value / high), -dot(up, eye) / high],
      [...back.map((value) => (value * (far + near)) / (near - far)), (-dot(back, eye) * (far + near)) / (near - far) + (2 * far * near) / (near - far)],
      [...back.map((value) => -value), dot(back, eye)],
    ];
    return { right, up, high, matrix: [0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])), rows };
  }

  function attribute(of, name, size, type, stride, offset, normalised = false) {
    const index = gl.getAttribLocation(of, name);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, size, type, normalised, stride, offset);
  }

  function draw() {
    asked = false;
    if (!canvas.clientWidth) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    view = look(width, height);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.965, 0.973, 0.98, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(points);
    gl.uniformMatrix4fv(gl.getUniformLocation(points, "view"), false, view.matrix);
    gl.uniform1f(gl.getUniformLocation(points, "unit"), scene.scale);
    gl.uniform1f(gl.getUniformLocation(points, "size"), (1.5 * scene.spacing * height) / (2 * view.high));
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.place);
    attribute(points, "place", 3, gl.UNSIGNED_SHORT, 6, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.colour);
    attribute(points, "colour", 3, gl.UNSIGNED_BYTE, 3, 0, true);
    gl.drawArrays(gl.POINTS, 0, scene.count);
    gl.useProgram(strips);
    gl.uniformMatrix4fv(gl.getUniformLocation(strips, "view"), false, view.matrix);
    gl.uniform2f(gl.getUniformLocation(strips, "pixel"), (2.2 * ratio) / width, (2.2 * ratio) / height);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers.strips);
    [["place", 3, 0], ["other", 3, 12], ["side", 1, 24], ["colour", 3, 28]].forEach(([name, size, offset]) =>
      attribute(strips, name, size, gl.FLOAT, 40, offset));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    // What stands behind others shines through a little.
    for (const [depth, opacity] of [[false, 0.3], [true, 1]]) {
      depth ? gl.enable(gl.DEPTH_TEST) : gl.disable(gl.DEPTH_TEST);
      gl.uniform1f(gl.getUniformLocation(strips, "opacity"), opacity);
      gl.drawArrays(gl.TRIANGLES, 0, numStrips);
    }
    for (const title of titles.children) {
      const [x, y, , w] = view.rows.map((row) => dot(row.slice(0, 3), title.at) + row[3]);
      title.style.display = w > 0 && Math.abs(x) < w && Math.abs(y) < w ? "" : "none";
      title.style.left = `${50 + (50 * x) / w}%`;
      title.style.top = `${50 - (50 * y) / w}%`;
    }
  }

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const moved = [event.clientX - before.clientX, event.clientY - before.clientY];
    const other = [...fingers.values()].find((one) => one.pointerId !== event.pointerId);
    if (other || event.buttons === 2 || event.shiftKey) {
      const step = (2 * view.high * turn.distance) / canvas.clientHeight / (other ? 2 : 1);
      turn.target = turn.target.map((value, axis) => value + step * (moved[1] * view.up[axis] - moved[0] * view.right[axis]));
      if (other) {
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) + 1;
        zoom(apart(before) / apart(event));
      }
    } else {
      turn.azimuth -= moved[0] * 0.008;
      turn.elevation = Math.min(1.55, Math.max(-1.55, turn.elevation + moved[1] * 0.008));
    }
    fingers.set(event.pointerId, event);
    ask();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(0.0015 * event.deltaY));
    ask();
  }, { passive: false });
  function zoom(factor) {
    turn.distance = Math.min(500, Math.max(0.1, turn.distance * factor));
  }

  at("scene-episode").addEventListener("input", open);
  for (const id of ["scene-colour", "scene-boxes", "scene-titles", "scene-truth"]) at(id).addEventListener("input", paint);
  at("scene-home").addEventListener("click", open);
  document.addEventListener("filtered", paint);
  window.addEventListener("resize", ask);
  open();
})();
