const byId = (id) => document.getElementById(id);

function quaternion(S) {  // qx, qy, qz, qw
  const turn = new THREE.Quaternion().setFromRotationMatrix(
    new THREE.Matrix4().set(S[0], S[1], S[2], 0, S[3], S[4], S[5], 0, S[6], S[7], S[8], 0, 0, 0, 0, 1));
  return turn.toArray();
}
// ---- the scene

const { size, axes_length: axesLength } = content;
const viewer = {
  scene: new THREE.Scene(),
  camera: new THREE.PerspectiveCamera(40),
  renderer: new THREE.WebGLRenderer({ antialias: true, alpha: true }),
  changed: true,  // whether the picture has to be drawn again
  resize() {
    const { clientWidth: width, clientHeight: height } = byId("scene");
    viewer.camera.aspect = width / height;
    viewer.camera.updateProjectionMatrix();
    viewer.renderer.setSize(width, height);
    viewer.changed = true;
  },
  draw() {
    viewer.controls.update();
    if (viewer.changed) viewer.renderer.render(viewer.scene, viewer.camera);
    viewer.changed = false;
  },
};
viewer.renderer.setPixelRatio(window.devicePixelRatio);
byId("scene").prepend(viewer.renderer.domElement);
viewer.controls = new THREE.OrbitControls(viewer.camera, viewer.renderer.domElement);
viewer.controls.addEventListener("change", () => { viewer.changed = true; });
viewer.scene.rotation.x = -Math.PI / 2;  // z of the world is up, as y is for the camera
viewer.scene.updateMatrixWorld();  // boxes are measured before anything is drawn
const world = new THREE.Group(), skyLight = new THREE.HemisphereLight(0xffffff, 0x8a8f99, 0.75);
skyLight.position.set(0, 0, 1);
viewer.scene.add(world, skyLight);
for (const [place, strength] of [[[3, -4, 5], 0.35], [[-4, 1, 2], 0.15]]) {
  const light = new THREE.DirectionalLight(0xffffff, strength);
  light.position.set(...place);
  viewer.scene.add(light);
}
function decode(text, Kind) {
  return new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
}
function creasedNormals(points, faces) {  // of each corner: the mean of the faces around it that turn by less than 30 degrees
  const count = faces.length / 3, normals = new Float32Array(3 * faces.length);
  const areas = new Float32Array(3 * count), around = Array.from({ length: points.length / 3 }, () => []);
  const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3(), sum = new THREE.Vector3();
  for (let k = 0; k < count; k++) {
    [a, b, c].forEach((corner, i) => corner.fromArray(points, 3 * faces[3 * k + i]));
    b.sub(a).cross(c.sub(a)).toArray(areas, 3 * k);
    for (let i = 0; i < 3; i++) around[faces[3 * k + i]].push(k);
  }
  for (let corner = 0; corner < faces.length; corner++) {
    a.fromArray(areas, 3 * Math.floor(corner / 3));
    sum.set(0, 0, 0);
    for (const k of around[faces[corner]])
      if (b.fromArray(areas, 3 * k).dot(a) >= 0.866 * b.length() * a.length()) sum.add(b);
    sum.normalize().toArray(normals, 3 * corner);
  }
  return normals;
}
function meshGeometry(shape) {
  const points = decode(shape.vertices, Float32Array), faces = decode(shape.faces, Uint32Array);
  const corners = new Float32Array(3 * faces.length);
  faces.forEach((vertex, corner) => {
    for (let i = 0; i < 3; i++) corners[3 * corner + i] = points[3 * vertex + i];
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(creasedNormals(points, faces), 3));
  return geometry;
}
function mesh(shape) {
  let geometry;
  if (shape.kind === "mesh") geometry = meshGeometry(shape);
  else if (shape.kind === "box") geometry = new THREE.BoxGeometry(...shape.size);
  else if (shape.kind === "sphere") geometry = new THREE.SphereGeometry(shape.radius, 32, 24);
  else geometry = new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 32);
  const { opacity } = content;
  const made = new THREE.Mesh(geometry, new THREE.MeshPhongMaterial(
    { color: shape.colour, transparent: opacity < 1, opacity, specular: 0x222222 }));
  if (shape.placement) made.applyMatrix4(new THREE.Matrix4().set(...shape.placement));
  return made;
}
function poseGroup(name) {
  const group = new THREE.Group();
  group.name = name;
  group.matrixAutoUpdate = false;
  world.add(group);
  return group;
}
function setPose(group, pose) {
  const { R, S } = pose;
  group.visible = isKnown(pose);
  if (group.visible)
    group.matrix.set(S[0], S[1], S[2], R[0], S[3], S[4], S[5], R[1], S[6], S[7], S[8], R[2], 0, 0, 0, 1);
  group.matrixWorldNeedsUpdate = true;
}
const bodies = content.bodies.map((body) => {
  const group = poseGroup(body.name);
  for (const shape of body.shapes) group.add(mesh(shape));
  return group;
});
const frames = content.frames.map((frame) => ({ ...frame, axesShown: content.axes_shown.includes(frame.name) }));
for (const frame of frames.filter((one) => one.axesShown)) {
  frame.axes = poseGroup(frame.name);
  frame.axes.add(new THREE.AxesHelper(axesLength));
}
function label(text) {  // a text that keeps its size on the screen, to the right of a point
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), font = "32px system-ui, sans-serif";
  pen.font = font;
  Object.assign(canvas, { width: Math.ceil(pen.measureText(text).width) + 24, height: 44 });
  Object.assign(pen, { font, lineWidth: 6, strokeStyle: "#fff", fillStyle: "#1b1b1b", lineJoin: "round" });
  pen.strokeText(text, 16, 33);
  pen.fillText(text, 16, 33);
  const map = new THREE.CanvasTexture(canvas), height = 0.025;  // as seen from one metre away
  const made = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
  made.scale.set(height * canvas.width / canvas.height, height, 1);
  made.center.set(0, 0.5);
  made.renderOrder = 2;
  return made;
}
for (const frame of frames.filter((one) => content.marks.includes(one.name))) {
  const dot = new THREE.Mesh(new THREE.SphereGeometry(0.012 * size, 16, 12),
    new THREE.MeshBasicMaterial({ color: 0xd62839, depthTest: false, transparent: true }));
  dot.renderOrder = 1;
  frame.mark = poseGroup(frame.name);
  frame.mark.add(dot, label(frame.name));
}
const struts = content.struts.map(({ name, frames: [first, second] }) => {  // rods from one frame to another
  const rod = new THREE.Mesh(new THREE.CylinderGeometry(0.012 * size, 0.012 * size, 1, 16),
    new THREE.MeshPhongMaterial({ color: 0x9a9fa8, specular: 0x222222 }));
  world.add(rod);
  return { name, rod, first, second, force: content.strut_forces[name] ?? null };
});
function setRod(rod, from, to) {
  const start = new THREE.Vector3(...from.R), end = new THREE.Vector3(...to.R), along = end.clone().sub(start);
  rod.visible = isKnown(from) && isKnown(to);
  rod.position.copy(start.add(end).multiplyScalar(0.5));
  rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
  rod.scale.set(1, along.length(), 1);
}
const selectedAxes = poseGroup("frame");
selectedAxes.add(new THREE.AxesHelper(axesLength));
const axes = content.joints.map((joint, k) => {  // a line along each joint's axis; always visible if there is only one coordinate
  const length = (dof === 1 ? 0.9 : 0.3) * size, radius = (dof === 1 ? 0.002 : 0.004) * size;
  const colour = dof === 1 ? 0x222222 : 0xd62839;
  const line = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, length, 8),
    new THREE.MeshBasicMaterial({ color: colour }));
  line.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...joint.n));
  line.visible = dof === 1;
  bodies[k + 1].add(line);
  return line;
});

// ---- paths of frames through all instants of the motion

function makePath(colour) {
  const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: colour }));
  line.frustumCulled = false;
  world.add(line);
  return line;
}
function tracePath(line, frame) {
  const points = [];
  for (let k = 0; k < count; k++) {
    const { R } = framePose(bodyPoses(baseAt(k), content.q[k]), frame);
    points.push(...(R.every(Number.isFinite) ? R : points.length ? points.slice(-3) : [0, 0, 0]));
  }
  line.geometry.dispose();
  line.geometry = new THREE.BufferGeometry();
  line.geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
}
const paths = [];
for (const [name, colour] of Object.entries(content.path_colours)) {
  const line = makePath(colour);
  tracePath(line, frames.find((frame) => frame.name === name));
  paths.push(line);
}
const selectedPath = makePath("#d62839");
paths.push(selectedPath);

// ---- readings

const inUnit = (si) => content.units[si] ?? [si, 1];  // name of the unit on the page, and the factor to it
const timeSince = (k) => content.t[k] * inUnit("s")[1] - content.since.offset;  // an instant as the page counts it
function formatRows(rows, width) {  // lines of names, numbers in SI units, and their units
  return rows.map(([name, values, si]) => {
    const [unit, factor] = inUnit(si);
    return name.padEnd(width) + values.map((x) => formatNumber(x === null ? x : factor * x)).join("") + " " + unit;
  }).join("\n");
}
function formatReadings(poses) {  // the instant, and of each strut its length and force
  const width = Math.max(7, ...struts.map(({ name }) => name.length + 8)), lines = [];
  if (count) lines.push(content.since.name ? `${content.since.name}${formatNumber(timeSince(frame))}`
    : formatRows([["t", [content.t[frame]], "s"]], width));
  for (const { name, first, second, force } of struts) {
    const rows = [[`${name} length`, [strutLength(framePose(poses, first), framePose(poses, second))], "m"]];
    if (force) rows.push([`${name} force`, [isManual ? null : force[frame]], "N"]);
    lines.push(formatRows(rows, width));
  }
  return lines.join("\n");
}
function formatFrame(poses, shown) {  // pose and, of an instant of the motion, velocity of the selected frame
  const rows = [["R", shown.R.map((x, i) => x + content.origin[i]), "m"]];
  if (content.coordinates.length) rows.push(["xyzw", isKnown(shown) ? quaternion(shown.S) : Array(4).fill(null), ""]);
  if (content.qd && content.base_rates) {
    const { v, omega } = isManual ? {} : bodyRates(poses, frame)[selectedFrame.body];
    const arm = shown.R.map((x, i) => x - poses[selectedFrame.body].R[i]);
    rows.push(["v", isManual ? [null, null, null] : add(v, cross(omega, arm)), "m/s"]);
    rows.push(["omega", isManual ? [null, null, null] : omega, "rad/s"]);
  }
  return formatRows(rows, 5);
}
function showEffort(i) {  // a bar of the torque or force of a joint against its limit
  if (!content.tau) return;
  const { bar, effort } = sliders[i], { effort_unit: si, effort_limit: limit } = content.coordinates[i];
  const value = isManual ? null : content.tau[frame][i], share = value === null || !limit ? 0 : Math.abs(value) / limit;
  const [unit, factor] = inUnit(si), text = (x) => Number((factor * x).toPrecision(4));
  effort.textContent = `motor ${value === null ? "-" : text(value)}${limit === null ? "" : ` of ${text(limit)}`} ${unit}`;
  bar.firstChild.style.width = `${100 * Math.min(1, share)}%`;
  bar.className = share > 1 ? "bar beyond" : "bar";
  bar.hidden = limit === null;
}
function formatPosition(unit, x) {
  if (x === null) return "-";
  const [name, factor] = unit === "rad" ? content.angle : inUnit(unit);
  const places = Math.max(0, (unit === "rad" ? 3 : 4) - Math.round(Math.log10(factor)));  // 0.1 degrees, 0.1 mm
  const sign = name === "deg" ? "\u00b0" : ` ${name}`;
  return (Number((factor * x).toFixed(places)) + 0).toFixed(places) + sign;  // + 0 removes the sign of a zero
}

// ---- the displayed pose: that of an instant of the motion, or that of the sliders

let frame = 0, q = positionsAt(0).slice(), isManual = !count, playing = false, clock = count ? content.t[0] : 0;
let selectedFrame = frames.find((one) => one.name === content.frame);
function draw() {
  const poses = bodyPoses(baseAt(frame), q);
  bodies.forEach((body, k) => setPose(body, poses[k]));
  for (const one of frames)
    for (const group of [one.axes, one.mark]) if (group) setPose(group, framePose(poses, one));
  for (const { rod, first, second } of struts) setRod(rod, framePose(poses, first), framePose(poses, second));
  const shown = framePose(poses, selectedFrame);
  setPose(selectedAxes, shown);
  const at = byId("follow").checked && isKnown(poses[0]) ? poses[0].R : [0, 0, 0];
  world.position.set(-at[0], -at[1], -at[2]);
  for (const line of paths) {
    line.visible = byId("trails").checked && count > 1;
    line.geometry.setDrawRange(0, frame + 1);
  }
  byId("numbers").textContent = formatReadings(poses);
  byId("position").textContent = formatFrame(poses, shown);
  content.coordinates.forEach(({ unit, limits: [lower, upper] }, i) => {
    const { input, output } = sliders[i], text = formatPosition(unit, q[i]);
    showEffort(i);
    input.disabled = q[i] === null;
    if (q[i] !== null) input.value = q[i];
    input.setAttribute("aria-valuetext", text);
    output.textContent = text;
    output.className =
      q[i] !== null && (lower !== null && q[i] < lower || upper !== null && q[i] > upper) ? "beyond" : "";
  });
  world.updateMatrixWorld(true);
  viewer.changed = true;
}
function show(k) {  // displays the pose at an instant of the motion
  frame = k;
  byId("time").value = k;
  q = positionsAt(k).slice();
  isManual = !count;
  draw();
}
function showManual(values) {  // displays a pose set by the sliders, and stops the motion
  play(false);
  isManual = true;
  q = values;
  draw();
}
const sliders = content.coordinates.map(({ name, unit, first, last, limits }, i) => {
  const row = document.createElement("div"), label = document.createElement("label");
  const input = document.createElement("input"), output = document.createElement("output");
  row.className = "joint";
  Object.assign(input, { type: "range", id: `joint${i}`, min: first, max: last, step: "any" });
  label.htmlFor = output.htmlFor = input.id;
  label.textContent = label.title = name;
  const [from, to] = [first, last].map((x) => formatPosition(unit, x));
  const free = limits.map((limit, side) => (limit === null ? ["lower", "upper"][side] : "")).filter(Boolean);
  input.title = free.length ? `no ${free.length > 1 ? "" : `${free[0]} `}limit; shown from ${from} to ${to}`
    : `limits ${formatPosition(unit, limits[0])} to ${formatPosition(unit, limits[1])}`;
  if (free.length) {
    const note = document.createElement("small");
    note.textContent = ` (no ${free.length > 1 ? "limits" : `${free[0]} limit`})`;
    label.append(note);
  }
  input.oninput = () => showManual(q.map((value, j) => (j === i ? Number(input.value) : value)));
  const ownAxes = axes.filter((_, k) => content.joints[k].coordinate === i);
  const light = (on) => {
    if (dof === 1) return;
    for (const line of ownAxes) line.visible = on || row.matches(":hover, :focus-within");
    viewer.changed = true;
  };
  row.onmouseenter = input.onfocus = () => light(true);
  row.onmouseleave = input.onblur = () => light(false);
  row.append(label, output, input);
  const bar = document.createElement("div"), effort = document.createElement("small");
  if (content.tau) {
    bar.append(document.createElement("div"));
    effort.title = "torque or force of the joint, and its limit";
    row.append(bar, effort);
  }
  return { row, input, output, bar, effort };
});
const variesInMotion = content.coordinates.map((_, i) => content.q.some((values) => values[i] !== content.q[0][i]));
content.chains.forEach(({ name, colour }, chain) => {
  const rows = sliders.filter((_, i) => content.coordinates[i].chain === chain).map(({ row }) => row);
  if (!rows.length) return;
  const group = document.createElement(content.chains.length > 1 ? "details" : "div");
  if (group.tagName === "DETAILS") {
    const summary = document.createElement("summary"), swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = colour;
    summary.append(swatch, name);
    group.open = !variesInMotion.some(Boolean) || variesInMotion.some((moves, i) => moves && content.coordinates[i].chain === chain);
    group.append(summary);
  }
  group.append(...rows);
  byId("joints").append(group);
});
byId("reset").onclick = () => showManual(neutral.slice());
for (const one of frames) byId("frame").append(new Option(one.name, one.name));
byId("frame").value = content.frame;
function selectFrame() {
  selectedFrame = frames.find((one) => one.name === byId("frame").value);
  selectedAxes.children[0].visible = !selectedFrame.axesShown;
  tracePath(selectedPath, selectedFrame);
  if (selectedFrame.name in content.path_colours) selectedPath.geometry = new THREE.BufferGeometry();
}
byId("frame").onchange = () => { selectFrame(); draw(); };

// ---- time

function markTime() {  // ticks under the time line, and marks where a coordinate or an effort is beyond its limits, of all samples
  const first = timeSince(0), last = timeSince(count - 1), span = last - first;
  if (!(span > 0)) return;
  const wanted = span / 8, unit = 10 ** Math.floor(Math.log10(wanted));
  const step = unit * [1, 2, 5, 10].find((factor) => factor * unit >= wanted);
  const [second, factor] = inUnit("s");
  const shortTime = (t) => `${Number((t * factor - content.since.offset).toPrecision(6))} ${second}`;
  const mark = (kind, k, width, text) => {
    const made = document.createElement("span");
    made.className = kind;
    made.style.left = `${100 * k / (count - 1)}%`;
    if (width !== null) made.style.width = `${100 * width / (count - 1)}%`;
    if (kind === "tick") made.textContent = text; else made.title = text;
    byId("ticks").append(made);
  };
  for (let n = Math.ceil(first / step); n * step <= last; n++)
    mark("tick", frameAt((n * step + content.since.offset) / factor), null, `${Number((n * step).toPrecision(12))}`);
  for (const { name, what, first, last } of content.events) {
    const [from, to] = [first, last].map(frameAt);
    mark("event", from, to - from, `${name} beyond ${what} from ${shortTime(first)} to ${shortTime(last)}`);
  }
}
let last = null;
function tick(now) {
  if (playing) {
    if (last !== null) clock += (now - last) / 1000 * Number(byId("speed").value);
    if (clock >= content.t[count - 1]) clock = content.t[0];
    const k = frameAt(clock);
    if (k !== frame || isManual) show(k);
  }
  last = now;
  viewer.draw();
  requestAnimationFrame(tick);
}
function play(on) {
  playing = on && count > 1;
  if (count) clock = content.t[frame];
  byId("play").textContent = playing ? "pause" : "play";
}
byId("time").max = count - 1;
if (count > 1) markTime();
byId("time").oninput = () => { play(false); show(Number(byId("time").value)); };
byId("play").onclick = () => play(!playing);
byId("follow").onchange = byId("trails").onchange = () => { aimCamera(); draw(); };
document.addEventListener("keydown", (event) => {
  if (event.code !== "Space" || event.target.closest("button, select, summary, input[type=checkbox]")) return;
  event.preventDefault();
  play(!playing);
});

// ---- the camera

const toViewerAxes = ([x, y, z]) => new THREE.Vector3(x, z, -y);  // converts a vector to the viewer's axes, whose y axis points up
function boxOf(k, values, relative) {  // bounding box of all bodies with a known pose, relative to the base or to the origin
  const box = new THREE.Box3(), base = baseAt(k), poses = bodyPoses(base, values);
  bodies.forEach((body, i) => setPose(body, poses[i]));
  world.position.set(0, 0, 0);
  world.updateMatrixWorld(true);
  for (const body of bodies.filter((one) => one.visible))
    for (const child of body.children) if (!axes.includes(child)) box.expandByObject(child);
  const ends = [...frames.filter(({ mark }) => mark), ...struts.flatMap(({ first, second }) => [first, second])];
  for (const one of ends.filter(({ body }) => bodies[body].visible))
    box.expandByPoint(toViewerAxes(framePose(poses, one).R));
  if (relative && isKnown(base)) box.translate(toViewerAxes(base.R).negate());
  return box;
}
const bounds = { one: boxOf(0, positionsAt(0), true), all: new THREE.Box3() };
for (let i = 0; i < Math.max(1, Math.min(count, 40)); i++) {
  const k = count > 1 ? Math.round(i * (count - 1) / (Math.min(count, 40) - 1)) : 0;
  bounds.all.union(boxOf(k, positionsAt(k), false));
  if (i) bounds.one.union(boxOf(k, positionsAt(k), true));
}
for (const box of Object.values(bounds))
  if (box.isEmpty()) box.set(new THREE.Vector3(-size, -size, -size), new THREE.Vector3(size, size, size));
const extent = (box) => box.getSize(new THREE.Vector3()).length();
const cell = (() => {  // size of a grid cell: 1, 2 or 5 times a power of ten
  const wanted = size / 4, unit = 10 ** Math.floor(Math.log10(wanted));
  return unit * [1, 2, 5, 10].find((factor) => factor * unit >= wanted);
})();
const originAxes = new THREE.AxesHelper(axesLength);
const cells = 2 * Math.ceil(Math.min(40, 0.6 * extent(bounds.all) / cell));
const grid = new THREE.GridHelper(cells * cell, cells, 0x9aa1ab, 0xc3c8d0);  // no wider than the camera's view
const middle = bounds.all.getCenter(new THREE.Vector3()), nearest = (x) => cell * Math.round(x / cell);
grid.rotation.x = Math.PI / 2;
// The grid shows the plane z = 0, and the axes the world's origin, if the motion is near them; a robot on a fixed base
// stands above the grid.
const near = content.origin.every((x) => Math.abs(x) <= 2 * extent(bounds.all));
const [x0, y0, z0] = content.origin.map((x) => (near ? -x : 0));
const floor = baseRests ? Math.min(z0, boxOf(0, positionsAt(0), false).min.y) : z0;
grid.position.set(x0 + nearest(middle.x - x0), y0 + nearest(-middle.z - y0), floor);
originAxes.position.set(x0, y0, z0);
viewer.scene.add(grid, originAxes);
function aimCamera() {
  const follow = byId("follow").checked, box = follow ? bounds.one : bounds.all;
  grid.visible = originAxes.visible = !follow;
  const centre = box.getCenter(new THREE.Vector3()), { camera, controls } = viewer;
  const covered = Math.min(0.4, byId("head").offsetHeight / byId("scene").clientHeight);  // share of the height behind the title
  const tangent = Math.tan(camera.fov * Math.PI / 360);
  const far = 0.48 * extent(box) / Math.sin(Math.atan(tangent * Math.min(1 - covered, camera.aspect)));
  centre.y += covered * tangent * far;
  camera.near = far / 1000;
  camera.far = 100 * far;
  camera.updateProjectionMatrix();
  controls.target.copy(centre);
  camera.position.copy(centre).addScaledVector(toViewerAxes([1, -0.8, 0.55]).normalize(), far);
  controls.update();
}
window.addEventListener("resize", viewer.resize);

// ---- the page

const instantsText = `${content.shown} instants`;
const title = document.createElement("b");
title.textContent = content.title;
byId("head").append(title);
for (const [colour, name] of content.legend) {
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.background = colour;
  byId("head").append(swatch, `${name} \u00a0`);
}
const gridText = Number((inUnit("m")[1] * cell).toPrecision(inUnit("m")[1] === 1 ? 1 : 3));
byId("hint").textContent = [
  "drag: turn, wheel: zoom, right button: move", `grid ${gridText} ${inUnit("m")[0]}`,
  ...(content.shown.includes("of") ? [instantsText] : []),
].join(" \u00b7 ");
byId("following").hidden = baseRests;
byId("following").querySelector("span").textContent = content.base;
byId("controls").hidden = count < 2;
byId("top").hidden = byId("joints").hidden = !dof;
byId("follow").checked = !baseRests && extent(bounds.all) > 4 * extent(bounds.one);
viewer.resize();
aimCamera();
selectFrame();
show(0);
window.hingepair = { viewer, bodies, show, showManual, content, bodyPoses, bodyRates, framePose, baseAt, frames };
if (count > 1) play(true);
requestAnimationFrame(tick);
