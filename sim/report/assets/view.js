"use strict";
// The three-dimensional view, in the world frame: metres, z up. It draws when something changed, never by itself.
const PAST_STEM_M = 0.014, AXIS_M = 0.06, TRACE_RADIUS_M = 0.0012;

// part(name) is an element of the run; onPick(step) is called for a click on a pose, and onLook for a move of the camera.
const makeView = (data, array, histories, { part, onPick, onLook }) => {
  const canvas = part("canvas"), holder = part("view");
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  // A look for errors would wait for the compiler.
  renderer.debug.checkShaderErrors = false;
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(32, 1, 0.02, 12);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.zoomToCursor = true;
  controls.minDistance = 0.05;
  controls.maxDistance = 6;
  scene.add(camera);

  // Two small programs draw everything, so that there is little to compile where no graphics card does it.
  const tinted = []; // [material, name of the colour's variable], so that the theme can change
  const program = (uniforms, vertexShader, fragmentShader, settings) => {
    const head = "precision highp float; ";
    return new THREE.RawShaderMaterial({
      uniforms: { colour: { value: new THREE.Color() }, ...uniforms }, glslVersion: "300 es",
      vertexShader: head + vertexShader, fragmentShader: head + fragmentShader, ...settings,
    });
  };
  const coloured = (material, colour) => {
    if (typeof colour === "string") tinted.push([material, colour]); else material.uniforms.colour.value.setRGB(...colour);
    return material;
  };
  const surfaceVertex = `uniform mat4 modelViewMatrix, projectionMatrix; uniform mat3 normalMatrix; in vec3 position, normal; out vec3 n, e; out float w;
    void main() { vec4 p = modelViewMatrix * vec4(position, 1.0); n = normalMatrix * normal; e = -p.xyz; w = dot(position, vec3(72.0)); gl_Position = projectionMatrix * p; }`;
  const surfaceFragment = `uniform vec3 colour; uniform float base, rim, stripes; in vec3 n, e; in float w; out vec4 seen;
    void main() {
      vec3 m = normalize(gl_FrontFacing ? n : -n), eye = normalize(e);
      if (rim > 0.0) { seen = vec4(colour, base + rim * pow(1.0 - abs(dot(m, eye)), 2.2)); return; }
      float key = max(dot(m, normalize(vec3(-0.35, 0.75, 0.6))), 0.0), fill = 0.5 + 0.5 * m.y;
      float glint = pow(max(dot(m, normalize(eye + vec3(-0.2, 0.6, 0.4))), 0.0), 40.0);
      float shade = abs(fract(w) - 0.5) < stripes ? 0.22 : 1.0;
      seen = vec4(colour * shade * (0.46 + 0.2 * fill + 0.46 * key) + 0.10 * glint, 1.0);
    }`;
  const surface = (colour, base, rim, stripes, settings) => coloured(program(
    { base: { value: base }, rim: { value: rim }, stripes: { value: stripes } }, surfaceVertex, surfaceFragment, settings,
  ), colour);
  const veil = (name, base, rim, side) => surface(name, base, rim, 0, { transparent: true, depthWrite: false, side: side ?? THREE.FrontSide });
  // Stripes of 4 mm tell a surface apart without its colour.
  const lit = (colour, { hasStripes = false, side = THREE.FrontSide } = {}) => surface(colour, 1, 0, hasStripes ? 0.25 : 0, { side });
  const stroke = (name, opacity) => coloured(program(
    { opacity: { value: opacity } },
    "uniform mat4 modelViewMatrix, projectionMatrix; in vec3 position; void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
    "uniform vec3 colour; uniform float opacity; out vec4 seen; void main() { seen = vec4(colour, opacity); }",
    { transparent: true, depthWrite: false },
  ), name);

  const attribute = values => new THREE.BufferAttribute(values, 3);
  const low = new THREE.Vector3(...data.bounds[0]), high = new THREE.Vector3(...data.bounds[1]);
  const surfaceGeometry = (vertices, faces, normals) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", attribute(vertices));
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    if (normals) geometry.setAttribute("normal", attribute(normals)); else geometry.computeVertexNormals();
    return geometry;
  };
  const geometryOf = mesh => {
    const fine = array(mesh.vertices), directions = array(mesh.normals), { low: [x, y, z], scale: [sx, sy, sz] } = mesh;
    const vertices = new Float32Array(fine.length);
    for (let i = 0; i < fine.length; i += 3) {
      vertices[i] = x + fine[i] * sx;
      vertices[i + 1] = y + fine[i + 1] * sy;
      vertices[i + 2] = z + fine[i + 2] * sz;
    }
    const geometry = surfaceGeometry(vertices, array(mesh.faces), Float32Array.from(directions));
    const reach = new THREE.Vector3(sx, sy, sz).multiplyScalar(65535 / 2);
    geometry.boundingSphere = new THREE.Sphere(reach.clone().add(new THREE.Vector3(x, y, z)), reach.length());
    return geometry;
  };
  const layer = () => { const group = new THREE.Group(); scene.add(group); return group; };
  const lines = (points, name, opacity) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(points), 3));
    return new THREE.LineSegments(geometry, stroke(name, opacity));
  };

  // Organ, true tumours, and the true bodies of a second class.
  const organ = layer(), truth = layer(), second = layer();
  const organBack = new THREE.Mesh(geometryOf(data.organ), veil("organ", 0.05, 0.16, THREE.BackSide));
  const organFront = new THREE.Mesh(organBack.geometry, veil("organ", 0.07, 0.42));
  organBack.renderOrder = 1;
  organFront.renderOrder = 4;
  organ.add(organBack, organFront);
  const tumourMaterial = veil("truth", 0.16, 0.9);
  for (const mesh of data.tumours) truth.add(new THREE.Mesh(geometryOf(mesh), tumourMaterial));
  const secondMaterial = veil("second", 0.16, 0.9);
  for (const mesh of data.target ? data.target.bodies : []) second.add(new THREE.Mesh(geometryOf(mesh), secondMaterial));
  for (const mesh of [...truth.children, ...second.children]) mesh.renderOrder = 3;

  // Vessels and the like, which may be open; those that must not be pressed are striped.
  const structures = layer(), keepouts = layer();
  const structureMaterial = lit("structure", { side: THREE.DoubleSide });
  const keepoutMaterial = lit("keepout", { side: THREE.DoubleSide, hasStripes: true });
  for (const mesh of data.structures) {
    const [group, material] = mesh.is_keepout ? [keepouts, keepoutMaterial] : [structures, structureMaterial];
    group.add(new THREE.Mesh(geometryOf(mesh), material));
  }
  const namesOf = isKeepout => data.structures.filter(mesh => mesh.is_keepout === isKeepout).map(mesh => mesh.name).join(", ");

  // A map's surface after an action.
  let level = data.map ? Math.log(data.map.called_from / (1 - data.map.called_from)) : 0;
  const mapLayer = (map, history, colour) => {
    const group = layer(), cut = history && history.cut, surfaces = new Map();
    const mesh = new THREE.Mesh(new THREE.BufferGeometry(), lit(colour));
    group.add(mesh);
    const surfaceAt = step => {
      const index = map ? map.steps.findLastIndex(kept => kept <= step) : -1;
      if (index < 0) return null;
      const key = `${index}/${level}`;
      if (!surfaces.has(key)) {
        const { positions, triangles } = cut(index, level), geometry = surfaceGeometry(positions, triangles);
        geometry.boundingSphere = organBack.geometry.boundingSphere; // the map ends where the organ does
        if (surfaces.size > 400) surfaces.clear();
        surfaces.set(key, { triangles: triangles.length / 3, geometry });
      }
      return surfaces.get(key);
    };
    const show = step => {
      const surface = surfaceAt(step);
      mesh.visible = Boolean(surface);
      if (surface) mesh.geometry = surface.geometry;
      return surface ? surface.triangles : 0;
    };
    return { group, show };
  };
  const mapped = mapLayer(data.map, histories.map, "map"), secondMapped = mapLayer(data.target && data.target.map, histories.target, "second-map");

  // Sensing poses: a dot and a stem against the beam; the present one with its cone.
  const probe = array(data.probe), nSteps = probe.length / 16;
  const poseAt = k => new THREE.Matrix4().fromArray(probe, 16 * k).transpose();
  const placeAt = k => new THREE.Vector3(probe[16 * k + 3], probe[16 * k + 7], probe[16 * k + 11]);
  const beamAt = k => new THREE.Vector3(probe[16 * k + 2], probe[16 * k + 6], probe[16 * k + 10]);
  const past = layer();
  // Balls of one size in one mesh; showFirst(n) of it shows the first ones alone.
  const balls = (places, radius, name, sides) => {
    const ball = new THREE.SphereGeometry(radius, sides, 2 * sides / 3), points = ball.attributes.position.array, corners = ball.index.array;
    const n = places.length / 3, vertices = new Float32Array(n * points.length), normals = new Float32Array(vertices.length), faces = new Uint32Array(n * corners.length);
    for (let k = 0; k < n; k++) {
      normals.set(ball.attributes.normal.array, k * points.length);
      for (let i = 0; i < points.length; i++) vertices[k * points.length + i] = points[i] + places[3 * k + i % 3];
      for (let i = 0; i < corners.length; i++) faces[k * corners.length + i] = corners[i] + k * points.length / 3;
    }
    const mesh = new THREE.Mesh(surfaceGeometry(vertices, faces, normals), lit(name));
    mesh.frustumCulled = false;
    mesh.showFirst = count => mesh.geometry.setDrawRange(0, count * corners.length);
    return mesh;
  };
  const stems = [], places = [];
  for (let k = 0; k < nSteps; k++) {
    const at = placeAt(k), end = at.clone().addScaledVector(beamAt(k), -PAST_STEM_M);
    places.push(...at);
    stems.push(...at, ...end);
  }
  const dots = balls(places, 0.0026, "probe", 12);
  const stemLines = lines(stems, "probe", 0.8);
  stemLines.frustumCulled = false;
  past.add(dots, stemLines);
  const sweep = layer(), cone = new THREE.Group(), { depth_m: depth, half_angle_rad: half } = data.cone;
  const radius = depth * Math.tan(half), coneGeometry = new THREE.ConeGeometry(radius, depth, 48, 1, true);
  coneGeometry.rotateX(-Math.PI / 2).translate(0, 0, depth / 2);
  const coneMesh = new THREE.Mesh(coneGeometry, veil("probe", 0.13, 0.22, THREE.DoubleSide));
  coneMesh.renderOrder = 5;
  const rim = [];
  for (let i = 0; i < 48; i++) for (const turn of [i, i + 1]) rim.push(radius * Math.cos(turn * Math.PI / 24), radius * Math.sin(turn * Math.PI / 24), depth);
  cone.add(coneMesh, lines(rim, "probe", 0.9), lines([0, 0, 0, 0, 0, depth], "probe", 0.9));
  cone.matrixAutoUpdate = false;
  sweep.add(cone);

  // The arm, and the way of its tip.
  const arm = layer(), bodies = [];
  if (data.arm) {
    for (let b = 0; b < data.arm.n_bodies; b++) { const body = new THREE.Group(); bodies.push(body); arm.add(body); }
    for (const part of data.arm.parts) {
      bodies[part.body].add(new THREE.Mesh(geometryOf(part), lit(part.colour.map(part => part ** 0.7))));
    }
  }
  const armPoses = data.arm && array(data.arm.poses);
  const ways = data.arm && data.arm.ways, wayPoses = ways && array(ways.poses);
  const placeBodies = pose => bodies.forEach((body, b) => {
    body.position.fromArray(pose(b), 0);
    const [w, x, y, z] = pose(b).slice(3);
    body.quaternion.set(x, y, z, w).normalize();
  });
  // The pose of a body on its way to an action, at a share of the time that the way takes.
  const onTheWay = (step, share) => {
    const at = share * (ways.n - 1), k = Math.min(Math.floor(at), ways.n - 2), t = at - k;
    const row = (b, k) => { const from = 7 * (((step - 1) * ways.n + k) * bodies.length + b); return Array.from(wayPoses.subarray(from, from + 7), (value, i) => value * (i < 3 ? ways.metre : 1)); };
    return b => {
      const a = row(b, k), c = row(b, k + 1), turn = a[3] * c[3] + a[4] * c[4] + a[5] * c[5] + a[6] * c[6] < 0 ? -1 : 1;
      return a.map((value, i) => value + t * (c[i] * (i < 3 ? 1 : turn) - value));
    };
  };
  const way = layer();
  let wayLine = null;
  if (data.paths && data.paths.ends.length) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(array(data.paths.points), 3));
    wayLine = new THREE.Line(geometry, stroke("ink", 0.4));
    wayLine.frustumCulled = false;
    way.add(wayLine);
  }

  // The way on the organ, coloured by time, and the readings on it.
  const traced = layer();
  let trace = null;
  if (data.trace) {
    const pieces = array(data.trace.pieces), tints = array(data.trace.colours), n = pieces.length / 6, sides = 4, each = 2 * sides;
    const vertices = new Float32Array(3 * each * n), normals = new Float32Array(3 * each * n), colours = new Float32Array(3 * each * n), faces = new Uint32Array(6 * sides * n);
    for (let k = 0; k < n; k++) {
      const ends = [0, 3].map(at => new THREE.Vector3().fromArray(pieces, 6 * k + at));
      const along = ends[1].clone().sub(ends[0]).normalize();
      const u = new THREE.Vector3(0, 0, 1).cross(along);
      if (u.length() < 1e-3) u.set(1, 0, 0);
      u.normalize();
      const v = along.clone().cross(u);
      for (let i = 0; i < each; i++) {
        const turn = Math.PI * (2 * (i % sides) + 1) / sides, at = 3 * (each * k + i);
        const out = u.clone().multiplyScalar(Math.cos(turn)).addScaledVector(v, Math.sin(turn));
        out.toArray(normals, at);
        ends[Math.floor(i / sides)].clone().addScaledVector(out, TRACE_RADIUS_M).toArray(vertices, at);
        colours.set(tints.subarray(3 * k, 3 * k + 3), at);
      }
      for (let i = 0; i < sides; i++) {
        const a = each * k + i, b = each * k + (i + 1) % sides;
        faces.set([a, b, a + sides, b, b + sides, a + sides], 6 * (sides * k + i));
      }
    }
    const geometry = surfaceGeometry(vertices, faces, normals);
    geometry.setAttribute("tint", attribute(colours));
    const mesh = new THREE.Mesh(geometry, program(
      {},
      "uniform mat4 modelViewMatrix, projectionMatrix; uniform mat3 normalMatrix; in vec3 position, normal, tint; out vec3 c; void main() { c = tint * (0.8 + 0.2 * normalize(normalMatrix * normal).z); gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
      "in vec3 c; out vec4 seen; void main() { seen = vec4(c, 1.0); }",
      { side: THREE.DoubleSide },
    ));
    mesh.frustumCulled = false;
    const readings = balls(array(data.trace.readings), 0.0016, "ink", 9);
    traced.add(mesh, readings);
    trace = { showFirst: step => {
      geometry.setDrawRange(0, step > 0 ? 6 * sides * data.trace.ends[Math.min(step, data.trace.ends.length) - 1] : 0);
      readings.showFirst(step > 0 ? data.trace.read[Math.min(step, data.trace.read.length) - 1] : 0);
    } };
  }

  // Poses that could not be taken: crosses.
  const refused = layer(), crosses = [];
  for (const [, x, y, z] of data.skipped) {
    for (const [a, b, c] of [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]) {
      const r = 0.0032; crosses.push(x + a * r, y + b * r, z + c * r, x - a * r, y - b * r, z - c * r);
    }
  }
  const crossLines = lines(crosses, "ink", 1);
  crossLines.frustumCulled = false;
  refused.add(crossLines);

  // Frames and the table.
  const frames = layer(), table = layer(), labels = [];
  const holderOfLabels = part("labels");
  const label = (text, at, group, soft, of, ends) => {
    const element = document.createElement("span");
    element.textContent = text;
    if (soft) element.className = "soft";
    holderOfLabels.append(element);
    labels.push({ element, at, group, of: of ?? at, ends });
    return labels[labels.length - 1];
  };
  const middle = low.clone().add(high).multiplyScalar(0.5), size = high.clone().sub(low);
  const unit = [new THREE.Vector3(1, 0, 0), new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, 1)];
  const triads = [];
  const triad = (at, axes, names, title, length) => {
    const points = [], ends = axes.map(axis => at.clone().addScaledVector(axis, length));
    axes.forEach((axis, i) => {
      const end = ends[i];
      const side = new THREE.Vector3().crossVectors(axis, axes[(i + 1) % 3]).normalize().multiplyScalar(length * 0.045);
      const neck = at.clone().addScaledVector(axis, length * 0.86);
      points.push(...at, ...end, ...end, ...neck.clone().add(side), ...end, ...neck.clone().sub(side));
      label(names[i], at.clone().addScaledVector(axis, length * 1.14), frames, false, at, ends);
    });
    const drawn = lines(points, "ink", 0.85);
    triads.push({ drawn, at });
    frames.add(drawn);
    if (title) label(title, at.clone().addScaledVector(unit[2], -length * 0.2), frames, true, at, ends);
  };
  const T = data.T_world_organ, organAxes = [0, 1, 2].map(i => new THREE.Vector3(T[0][i], T[1][i], T[2][i]));
  const beside = new THREE.Vector3(low.x - 0.06 * size.x, low.y - 0.06 * size.y, Math.max(low.z, 0) + 0.001);
  triad(beside, unit, ["x", "y", "z"], "world axes", AXIS_M);
  if (data.base) {
    const B = data.base;
    triad(new THREE.Vector3(B[0][3], B[1][3], B[2][3] + 0.002), [0, 1, 2].map(i => new THREE.Vector3(B[0][i], B[1][i], B[2][i])), ["x", "y", ""], "arm base", 0.16);
  }
  const isTurned = organAxes.some((axis, i) => axis.distanceTo(unit[i]) > 1e-6);
  if (isTurned || data.is_patient) {
    const names = data.is_patient ? ["x left", "y back", "z head"] : ["x", "y", "z"];
    triad(new THREE.Vector3(high.x + 0.02 * size.x, middle.y - 0.12 * size.y, Math.max(low.z, 0) + 1.25 * AXIS_M), organAxes, names, "organ axes", AXIS_M);
  }
  const tipFrame = new THREE.Group();
  tipFrame.matrixAutoUpdate = false;
  tipFrame.add(lines([0, 0, 0, 0.022, 0, 0, 0, 0, 0, 0, 0.022, 0], "ink", 0.9));
  frames.add(tipFrame);
  const beamLabel = label("z beam", new THREE.Vector3(), sweep, false);
  const gridPoints = [], nLines = 16, pitch = 0.05;
  const [gx, gy] = [middle.x, middle.y].map(at => Math.round(at / pitch) * pitch);
  for (let i = -nLines; i <= nLines; i++) {
    const a = i * pitch, r = nLines * pitch;
    gridPoints.push(gx + a, gy - r, -5e-4, gx + a, gy + r, -5e-4, gx - r, gy + a, -5e-4, gx + r, gy + a, -5e-4);
  }
  const grid = lines(gridPoints, "ink", 0.1);
  grid.material.depthWrite = false;
  table.add(grid);
  part("scale").textContent = "Grid on the table: 50 mm";

  // Camera.
  const look = (target, direction, distance) => {
    controls.target.copy(target);
    camera.position.copy(target).addScaledVector(direction.normalize(), distance);
    controls.update();
    request();
  };
  // From a direction, as near as all of some points can be seen.
  const show = (points, direction, share) => {
    const target = points.reduce((sum, point) => sum.add(point), new THREE.Vector3()).divideScalar(points.length);
    const back = direction.normalize(), right = new THREE.Vector3().crossVectors(camera.up, back).normalize();
    const up = new THREE.Vector3().crossVectors(back, right), tangent = Math.tan(camera.fov * Math.PI / 360) * share;
    const distances = points.map(point => {
      const from = point.clone().sub(target);
      return from.dot(back) + Math.max(Math.abs(from.dot(right)) / (tangent * camera.aspect), Math.abs(from.dot(up)) / tangent);
    });
    look(target, back, Math.max(...distances));
  };
  const corners = [];
  for (const x of [low.x, high.x]) for (const y of [low.y, high.y]) for (const z of [low.z, high.z]) corners.push(new THREE.Vector3(x, y, z));
  const within = corners.map(corner => corner.clone().lerp(middle, 0.06)), head = new THREE.Vector3(middle.x, middle.y, high.z + 0.05);
  const foot = data.base ? [0, 1].map(i => new THREE.Vector3(data.base[0][3], data.base[1][3], 0.85 * i)) : corners.map(corner => corner.clone().lerp(middle, -0.8));
  const presets = {
    organ: () => show([...within, head, head, beside], new THREE.Vector3(0.62, -1, 0.62), 1.0),
    arm: () => show([...corners, ...foot, ...foot], new THREE.Vector3(0.5, -1, 0.42), 0.9),
    top: () => show(corners, new THREE.Vector3(0, -0.0015, 1), 0.85),
    side: () => show([...corners, head], new THREE.Vector3(0, -1, 0), 0.85),
  };

  // Nothing is drawn before everything is in its place.
  let wanted = false, isReady = false;
  const request = () => { if (isReady && !wanted) { wanted = true; requestAnimationFrame(draw); } };
  const resize = () => {
    const { clientWidth: width, clientHeight: height } = holder;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    request();
  };
  const draw = () => {
    wanted = false;
    const { clientWidth: width, clientHeight: height } = holder, spot = new THREE.Vector3();
    const isInView = at => { spot.copy(at).project(camera); return spot.z < 1 && Math.abs(spot.x) < 0.98 && Math.abs(spot.y) < 0.98; };
    camera.updateMatrixWorld();
    // The tips of a triad would tell nothing without its origin.
    for (const { drawn, at } of triads) drawn.visible = isInView(at);
    renderer.render(scene, camera);
    // A triad that is seen from far away would be covered by its labels.
    const isLong = (from, to) => {
      const a = from.clone().project(camera), b = to.clone().project(camera);
      return Math.hypot((a.x - b.x) * width, (a.y - b.y) * height) / 2 > 44;
    };
    for (const { element, at, group, of, ends } of labels) {
      const isShown = group.visible && element.textContent && isInView(of) && (!ends || ends.some(end => isLong(of, end))) && isInView(at);
      element.style.display = isShown ? "" : "none";
      if (!isShown) continue;
      // No label is cut off at the edge.
      const half = element.offsetWidth / 2 + 4, across = Math.min(Math.max((spot.x + 1) / 2 * width, half), width - half);
      element.style.transform = `translate(${across.toFixed(1)}px, ${((1 - spot.y) / 2 * height).toFixed(1)}px) translate(-50%, -50%)`;
    }
  };
  const state = { step: 0, mapTriangles: 0, targetTriangles: 0, tip: null, isMoving: false };
  // The camera stays out of organ and arm: a move that would bring it in is not made, and it backs off from an arm that
  // comes to it. A body is where one of its vertices is near, or where an odd number of its triangles lie above.
  const NEAR_M = 0.03, solids = [];
  const addSolid = (mesh, name) => {
    mesh.geometry.computeBoundingBox();
    const box = mesh.geometry.boundingBox.clone().expandByScalar(NEAR_M);
    solids.push({ mesh, name, box, points: mesh.geometry.attributes.position.array, faces: mesh.geometry.index.array });
  };
  addSolid(organBack, "organ");
  for (const body of bodies) for (const mesh of body.children) addSolid(mesh, "arm");
  const isIn = ({ points, faces }, p) => {
    for (let i = 0; i < points.length; i += 3) if ((points[i] - p.x) ** 2 + (points[i + 1] - p.y) ** 2 + (points[i + 2] - p.z) ** 2 < NEAR_M ** 2) return true;
    let isOdd = false;
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
      const area = (points[b] - points[a]) * (points[c + 1] - points[a + 1]) - (points[c] - points[a]) * (points[b + 1] - points[a + 1]);
      const s = ((p.x - points[a]) * (points[c + 1] - points[a + 1]) - (p.y - points[a + 1]) * (points[c] - points[a])) / area;
      const t = ((points[b] - points[a]) * (p.y - points[a + 1]) - (points[b + 1] - points[a + 1]) * (p.x - points[a])) / area;
      if (area && s >= 0 && t >= 0 && s + t < 1 && points[a + 2] + s * (points[b + 2] - points[a + 2]) + t * (points[c + 2] - points[a + 2]) > p.z) isOdd = !isOdd;
    }
    return isOdd;
  };
  const isBlocked = at => solids.some(solid => {
    if (!solid.mesh.parent.parent || !solid.mesh.parent.visible || (solid.name === "arm" && !arm.visible)) return false;
    solid.mesh.updateWorldMatrix(true, false);
    const p = solid.mesh.worldToLocal(at.clone());
    return solid.box.containsPoint(p) && isIn(solid, p);
  });
  const good = { position: new THREE.Vector3(), target: new THREE.Vector3(), isKnown: false };
  const keepOut = backsOff => {
    if (isBlocked(camera.position)) {
      if (good.isKnown && !backsOff) {
        camera.position.copy(good.position);
        controls.target.copy(good.target);
      } else {
        const back = camera.position.clone().sub(controls.target).normalize();
        for (let i = 0; i < 60 && isBlocked(camera.position); i++) camera.position.addScaledVector(back, 0.03);
      }
      camera.lookAt(controls.target);
    }
    good.position.copy(camera.position);
    good.target.copy(controls.target);
    good.isKnown = true;
  };
  state.isBlocked = () => isBlocked(camera.position);
  controls.addEventListener("change", () => {
    keepOut(false);
    request();
    if (isReady) onLook({ position: camera.position.clone().sub(middle), target: controls.target.clone().sub(middle) });
  });
  // What another view of an organ looks at, from the same side.
  const lookAs = ({ position, target }) => {
    camera.position.copy(position).add(middle);
    controls.target.copy(target).add(middle);
    camera.lookAt(controls.target);
    keepOut(true);
    request();
  };
  new ResizeObserver(resize).observe(holder);

  const applyTheme = () => {
    const style = getComputedStyle(document.documentElement);
    const named = name => style.getPropertyValue(`--${name}`).trim();
    // The shaders write what the screen shows.
    for (const [material, name] of tinted) {
      material.uniforms.colour.value.setStyle(named(name), THREE.LinearSRGBColorSpace);
    }
    request();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", applyTheme);

  // The arm goes to the action; the cone is there when the arm is.
  let moving = 0;
  const move = (step, ms, rest) => {
    const mine = moving, began = performance.now();
    const frame = now => {
      if (mine !== moving) return;
      const share = Math.min((now - began) / ms, 1);
      cone.visible = tipFrame.visible = share === 1;
      state.isMoving = share < 1;
      placeBodies(share === 1 ? rest : onTheWay(step, share));
      keepOut(true);
      request();
      if (share < 1) requestAnimationFrame(frame);
    };
    placeBodies(onTheWay(step, 0));
    cone.visible = tipFrame.visible = false;
    state.isMoving = true;
    requestAnimationFrame(frame);
  };
  const setStep = (step, moveMs = 0) => {
    state.step = step;
    dots.showFirst(step);
    if (trace) trace.showFirst(step);
    stemLines.geometry.setDrawRange(0, 2 * step);
    crossLines.geometry.setDrawRange(0, 8 * data.skipped.filter(([at]) => at <= Math.max(step, 1)).length * (step > 0));
    cone.visible = tipFrame.visible = step > 0;
    beamLabel.group = step > 0 ? sweep : { visible: false };
    if (step > 0) {
      cone.matrix.copy(poseAt(step - 1));
      tipFrame.matrix.copy(cone.matrix);
      beamLabel.at.copy(placeAt(step - 1)).addScaledVector(beamAt(step - 1), depth * 1.06);
      state.tip = placeAt(step - 1).toArray();
    } else state.tip = null;
    if (wayLine) wayLine.geometry.setDrawRange(0, step > 0 ? data.paths.ends[Math.min(step, data.paths.ends.length) - 1] : 0);
    moving++;
    state.isMoving = false;
    if (armPoses) {
      const row = Math.min(step, armPoses.length / 7 / bodies.length - 1);
      const rest = b => Array.from(armPoses.subarray(7 * (row * bodies.length + b), 7 * (row * bodies.length + b) + 7));
      if (moveMs && ways && step <= ways.n_motions && step > 0) move(step, moveMs, rest); else placeBodies(rest);
    }
    keepOut(true);
    drawMap();
    request();
  };
  const drawMap = () => {
    state.mapTriangles = mapped.show(state.step);
    state.targetTriangles = secondMapped.show(state.step);
    request();
  };

  // A click on a dot goes to its action.
  let pressed = null;
  canvas.addEventListener("pointerdown", event => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", event => {
    if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    const box = canvas.getBoundingClientRect(), spot = new THREE.Vector3();
    let best = null, least = 12;
    for (let k = 0; k < nSteps; k++) {
      spot.copy(placeAt(k)).project(camera);
      const away = Math.hypot((spot.x + 1) / 2 * box.width - event.clientX + box.left, (1 - spot.y) / 2 * box.height - event.clientY + box.top);
      if (away < least) [best, least] = [k + 1, away];
    }
    if (best !== null) onPick(best);
  });

  applyTheme();
  resize();
  presets.organ();
  const layers = [
    ["organ", "Organ", organ, "organ"], ["truth", "True tumours", truth, "truth"], ["map", "Map", mapped.group, "map"],
    ["target-truth", `True ${data.target && data.target.name}`, second, "second"], ["target-map", `Map of ${data.target && data.target.name}`, secondMapped.group, "second-map"],
    ["structures", "Vessels and the like", structures, "structure", namesOf(false)],
    ["keepouts", "Must not be pressed", keepouts, "keepout", namesOf(true)],
    ["poses", "Sensing poses", past, "probe"], ["cone", "Cone", sweep, "probe"], ["arm", data.base ? "Arm" : "Probe", arm, null],
    ["trace", "Way on the organ", traced, "trace", "from dark violet at the beginning to yellow at the end, with a ball at each reading"], ["way", "Way of the tip", way, null], ["refused", "Not reachable", refused, null],
    ["frames", "Axes", frames, null], ["table", "Table", table, null],
  ].filter(([name, , group]) => !(["structures", "keepouts"].includes(name) && !group.children.length) && !(name === "map" && !data.map) && !(name === "arm" && !data.arm) && !(name === "way" && !wayLine) && !(name === "trace" && !trace)
    && !(name === "refused" && !data.skipped.length) && !(name === "truth" && !data.tumours.length)
    && !(name === "target-truth" && !data.target) && !(name === "target-map" && !(data.target && data.target.map)));
  way.visible = false;
  return {
    setStep, presets, layers, request, state, lookAs, zoom: distance => look(controls.target, camera.position.clone().sub(controls.target), distance), renderNow: () => { isReady = true; draw(); },
    setLevel: probability => { level = Math.log(probability / (1 - probability)); drawMap(); },
  };
};
