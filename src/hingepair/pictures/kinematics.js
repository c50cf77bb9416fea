// What a page computes of its content, apart from drawing: poses, rates, rows at instants, numbers as text. The tests run it by node.
const count = content.t.length, dof = content.coordinates.length;

// ---- forward kinematics in double precision; a rotation is an array of nine numbers, row by row

function multiply(A, B) {
  const C = [];
  for (let i = 0; i < 9; i += 3)
    for (let j = 0; j < 3; j++) C.push(A[i] * B[j] + A[i + 1] * B[j + 3] + A[i + 2] * B[j + 6]);
  return C;
}
function rotate(A, v) {
  return [0, 3, 6].map((i) => A[i] * v[0] + A[i + 1] * v[1] + A[i + 2] * v[2]);
}
function add(a, b) {
  return a.map((x, i) => x + b[i]);
}
function hingeRotation([x, y, z], angle) {  // E6, with 2 sin^2(angle/2) for 1 - cos(angle)
  const s = Math.sin(angle), half = Math.sin(angle / 2), c = 2 * half * half;
  return [
    1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y,
    c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x,
    c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y),
  ];
}
function compose(pose, frame) {
  return { R: add(pose.R, rotate(pose.S, frame.R)), S: multiply(pose.S, frame.S) };
}
function bodyPoses(base, q) {  // poses of all bodies, the base first; NaN behind a joint whose coordinate is unknown
  const poses = [base];
  for (const joint of content.joints) {
    const position = joint.multiplier * known(q[joint.coordinate]) + joint.offset;
    const home = compose(poses[joint.parent], { R: joint.u, S: joint.S });
    const [turns, shifts] = joint.axis;
    poses.push({
      R: add(home.R, rotate(home.S, joint.n.map((x) => x * shifts * position))),
      S: multiply(home.S, hingeRotation(joint.n, turns * position)),
    });
  }
  return poses;
}
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function known(x) {  // a number of the content, in which null stands for what is not known
  return x === null ? NaN : x;
}
function bodyRates(poses, k) {  // v and omega of all bodies at an instant, in world axes; NaN where not known
  const [v, omega] = ["v", "omega"].map((name) => content.base_rates[name][baseRests ? 0 : k].map(known));
  const rates = [{ v, omega }];
  content.joints.forEach((joint, i) => {
    const rate = joint.multiplier * known(content.qd[k][joint.coordinate]), [turns, shifts] = joint.axis;
    const carrier = rates[joint.parent], own = poses[i + 1], n = rotate(own.S, joint.n);
    const arm = own.R.map((x, j) => x - poses[joint.parent].R[j]), swung = cross(carrier.omega, arm);
    rates.push({
      v: carrier.v.map((x, j) => x + swung[j] + shifts * rate * n[j]),
      omega: carrier.omega.map((x, j) => x + turns * rate * n[j]),
    });
  });
  return rates;
}
function baseAt(k) {
  const m = content.placements[baseRests ? 0 : k];
  const unknown = Array(9).fill(NaN);
  return m === null ? { R: unknown.slice(0, 3), S: unknown }
    : { R: [m[3], m[7], m[11]], S: [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]] };
}
function framePose(poses, frame) {
  return compose(poses[frame.body], frame);
}
function strutLength(first, second) {
  return Math.hypot(...first.R.map((x, i) => second.R[i] - x));
}
const baseRests = content.placements.length === 1;
const isKnown = (pose) => [...pose.R, ...pose.S].every(Number.isFinite);
const neutral = content.coordinates.map((coordinate) => coordinate.neutral);
const positionsAt = (k) => (count ? content.q[k] : neutral);


// ---- instants and numbers

function frameAt(time) {
  let low = 0, high = count - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (content.t[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
}
function formatNumber(x) {  // a number in at most eight characters, padded to nine; coordinates on maps have ten
  if (x === null || !Number.isFinite(x)) return "-".padStart(9);
  const size = Math.abs(x), small = size !== 0 && size < 1e-3, large = size >= 1e8;
  if (size >= 1e5 && !large) return ` ${x.toFixed(size < 1e6 ? 2 : 1)}`.padStart(9);
  return (small || large ? x.toExponential(1) : size < 1 ? (x + 0).toFixed(5) : x.toPrecision(5)).padStart(9);
}
