// A scene as points, with the path of a trial: three.js of the distribution (libjs-three).
"use strict";
(async () => {
  const { run_address } = segsim;
  const node = (id) => document.getElementById(id);
  const key = segsim.parameters.get("run") || "", id = segsim.parameters.get("trial");
  const mode_colors = [0x8e6bbf, 0x1e74c4, 0xf07820, 0xd22832, 0xf07820];
  const say = (text) => {
    node("message").textContent = text;
    node("message").classList.remove("hidden");
    segsim.ready();
  };
  node("run").href = `/run.html?run=${encodeURIComponent(key)}`;
  if (!window.THREE || !THREE.OrbitControls) {
    return say("No 3-D view: this machine has no three.js (Debian: apt-get install libjs-three, then build again).");
  }

  // number, positions, colours, colours of classes; see point_bytes().
  const points_from = (bytes) => {
    const count = new DataView(bytes).getUint32(0, true);
    return { count, xyz: new Float32Array(bytes, 4, 3 * count), rgb: new Uint8Array(bytes, 4 + 12 * count, 3 * count),
      classes: new Uint8Array(bytes, 4 + 15 * count, 3 * count) };
  };

  let trial = null, scene_number = Number(segsim.parameters.get("scene") || 0), geometry = null, cloud = null;
  try {
    if (id !== null) {
      trial = await segsim.get_json(run_address(key, "trials", id));
      scene_number = trial.scene_number;
    }
    geometry = await segsim.get_json(run_address(key, "scenes", scene_number, "floor.json"));
    cloud = points_from(await (await segsim.get(run_address(key, "scenes", scene_number, "points.bin"))).arrayBuffer());
  } catch (error) {
    return say(error.message);
  }
  if (trial) {
    node("title").textContent = `${trial.trial.episode}, arm ${trial.trial.arm}: ${segsim.words(trial.trial.outcome)}`;
    node("trial").href = `/trial.html?run=${encodeURIComponent(key)}&trial=${trial.trial.id}`;
    node("trial").classList.remove("hidden");
  } else {
    node("title").textContent = geometry.title;
  }

  const stage = node("stage");
  let renderer = null;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true });
  } catch (error) {
    return say("No 3-D view: this browser has no WebGL.");
  }
  stage.prepend(renderer.domElement);
  const world = new THREE.Scene();
  world.background = new THREE.Color(0x14171a);
  const camera = new THREE.PerspectiveCamera(50, 1, 0.05, 500);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);

  const buffer = new THREE.BufferGeometry();
  const material = new THREE.PointsMaterial({ vertexColors: THREE.VertexColors, sizeAttenuation: true });
  world.add(new THREE.Points(buffer, material));
  const fill = () => {
    const highest = Number(node("cut").value);
    node("cut-text").textContent = `${highest.toFixed(2)} m`;
    const colors = node("classes").checked ? cloud.classes : cloud.rgb;
    const kept = [];
    for (let k = 0; k < cloud.count; ++k) if (cloud.xyz[3 * k + 2] <= highest) kept.push(k);
    const xyz = new Float32Array(3 * kept.length), rgb = new Float32Array(3 * kept.length);
    kept.forEach((k, n) => {
      for (let c = 0; c < 3; ++c) {
        xyz[3 * n + c] = cloud.xyz[3 * k + c];
        rgb[3 * n + c] = colors[3 * k + c] / 255;
      }
    });
    buffer.setAttribute("position", new THREE.BufferAttribute(xyz, 3));
    buffer.setAttribute("color", new THREE.BufferAttribute(rgb, 3));
    buffer.computeBoundingSphere();
    node("count").textContent = `${kept.length.toLocaleString("en")} of ${geometry.surfels.toLocaleString("en")} surfels, as points`;
    return xyz;
  };

  // A tube along [x, y] places at a height.
  const tube = (places, color, height, radius) => {
    const corners = places.filter((p, k) => k === 0 || Math.hypot(p[0] - places[k - 1][0], p[1] - places[k - 1][1]) > 1e-3)
      .map(([x, y]) => new THREE.Vector3(x, y, height));
    if (corners.length < 2) return;
    const curve = new THREE.CatmullRomCurve3(corners, false, "catmullrom", 0);
    world.add(new THREE.Mesh(new THREE.TubeBufferGeometry(curve, 2 * corners.length, radius, 6), new THREE.MeshBasicMaterial({ color })));
  };
  const goals = new THREE.Group();
  world.add(goals);
  if (trial) {
    tube(trial.way, 0xb9c0c6, 0.06, 0.015);
    // Pieces of one mode; places nearer than 4 cm are left out.
    let piece = [], mode = null, last = null;
    trial.ticks.forEach((t, k) => {
      const place = [t[1], t[2]];
      if (mode !== null && t[6] !== mode) {
        tube([...piece, place], mode_colors[mode], 0.12, 0.035);
        piece = [];
        last = null;
      }
      mode = t[6];
      if (last && Math.hypot(place[0] - last[0], place[1] - last[1]) < 0.04 && k + 1 < trial.ticks.length) return;
      piece.push(place);
      last = place;
    });
    tube(piece, mode_colors[mode], 0.12, 0.035);
    const end = trial.ticks[trial.ticks.length - 1];
    const robot = new THREE.Mesh(new THREE.ConeBufferGeometry(0.18, 0.5, 20), new THREE.MeshBasicMaterial({ color: 0xffffff }));
    robot.rotation.set(0, 0, end[3] - Math.PI / 2);
    robot.position.set(end[1], end[2], 0.25);
    world.add(robot);
    for (const object of geometry.objects.filter((candidate) => segsim.is_goal(candidate, trial))) {
      const box = new THREE.Box3(new THREE.Vector3(...object.low), new THREE.Vector3(...object.high));
      goals.add(new THREE.Box3Helper(box, 0x30e080));
    }
  }

  const draw = () => {
    // three.js measures sizes at a field of view of 90 degrees.
    material.size = Number(node("size").value) / 100 / Math.tan(camera.fov * Math.PI / 360);
    goals.visible = node("boxes").checked;
    renderer.render(world, camera);
  };
  const fit = () => {
    renderer.setPixelRatio(window.devicePixelRatio || 1);
    renderer.setSize(stage.clientWidth, stage.clientHeight);
    camera.aspect = stage.clientWidth / stage.clientHeight;
    camera.updateProjectionMatrix();
    draw();
  };
  const xyz = fill();
  // The middle of most points: strays do not count.
  const middle = [0, 1].map((c) => {
    const values = Array.from({ length: Math.min(2000, xyz.length / 3) }, (_, n) => xyz[3 * Math.floor(n * xyz.length / 3 / Math.min(2000, xyz.length / 3)) + c]).sort((a, b) => a - b);
    return { low: values[Math.floor(0.02 * values.length)] || 0, high: values[Math.floor(0.98 * (values.length - 1))] || 1 };
  });
  const centre = new THREE.Vector3((middle[0].low + middle[0].high) / 2, (middle[1].low + middle[1].high) / 2, 0.5);
  const side = Math.max(middle[0].high - middle[0].low, middle[1].high - middle[1].low);
  controls.target.copy(centre);
  camera.position.set(centre.x - 0.2 * side, centre.y - 0.62 * side, 0.68 * side);
  // Points of about the size of the gaps between them.
  node("size").value = 130 * side / Math.sqrt(Math.max(1, xyz.length / 3));
  controls.update();
  controls.addEventListener("change", draw);
  window.addEventListener("resize", fit);
  for (const control of ["cut", "classes"]) node(control).addEventListener("input", () => { fill(); draw(); });
  for (const control of ["size", "boxes"]) node(control).addEventListener("input", draw);
  node("message").classList.add("hidden");
  fit();
  segsim.ready();
})();
