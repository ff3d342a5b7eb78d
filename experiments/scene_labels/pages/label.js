// Labels of a scene: a view, the objects in it, and what can be done to them.
"use strict";
(() => {
  const { element, fill } = segsim;
  const node = (id) => document.getElementById(id);
  const canvas = node("picture");
  const kStep_m = 0.15, kTurn_rad = 0.09, kDrag_px = 4;

  let scene = null, cameras = [];
  let view = { camera: null, x: 0, y: 0, z: 1.2, yaw: 0, pitch: 0 };
  let chosen = 0, hovered = 0;   // Instances; 0: none.
  let mode = null;               // null, or {kind: "merge"}, or {kind: "cut", seeds: [...]}.
  let busy = false;              // An edit is under way.

  // ---- messages -----------------------------------------------------------------------------
  const say = (text, kind = "faint") => {
    node("message").textContent = text;
    node("message").className = `message ${kind}`;
  };
  const complain = (error) => say(error.message, "error");

  // ---- the view -----------------------------------------------------------------------------
  const { draw, paint, under, pick } = label_view(canvas, () => ({
    view, chosen, hovered, revision: scene.revision, classes: scene.classes,
    strength: Number(node("overlay").value), seeds: mode && mode.kind === "cut" ? mode.seeds : [] }), complain);

  const show_camera = () => { node("camera").value = view.camera === null ? "" : String(view.camera); };
  const to_camera = (number) => {
    view = { ...cameras[number], camera: number };
    show_camera();
    draw();
  };
  const beside = (step) => {
    if (cameras.length === 0) return say("The bundle has no cameras of its recording.", "error");
    to_camera(((view.camera === null ? (step > 0 ? -1 : 0) : view.camera) + step + cameras.length) % cameras.length);
  };
  // The recording's camera that has the object nearest to the middle of its view, two metres off; walls
  // between are not looked for. Without one, the camera turns where it is.
  const face = (of) => {
    if (!of || !of.low) return;
    const goal = of.low.map((v, k) => (v + of.high[k]) / 2);
    const aim = (c) => {
      const [x, y, z] = [goal[0] - c.x, goal[1] - c.y, goal[2] - c.z];
      const yaw = Math.atan2(y, x), pitch = -Math.atan2(z, Math.hypot(x, y));
      const turn = Math.atan2(Math.sin(yaw - c.yaw), Math.cos(yaw - c.yaw));
      return { yaw, pitch, off: Math.hypot(turn, pitch - c.pitch), far: Math.hypot(x, y, z) };
    };
    const cost = (c) => { const { off, far } = aim(c); return off + 0.5 * Math.abs(far - 2); };
    const best = cameras.reduce((a, c, k) => (cost(c) < cost(cameras[a]) ? k : a), 0);
    if (cameras.length > 0 && aim(cameras[best]).off < 0.4) return to_camera(best);
    const { yaw, pitch } = aim(view);
    move(0, 0, 0, yaw - view.yaw, pitch - view.pitch);
  };
  // Metres along the view, to its left and up; radians to the left and down.
  const move = (forward, left, up, turn = 0, down = 0) => {
    const [c, s] = [Math.cos(view.yaw), Math.sin(view.yaw)], level = Math.cos(view.pitch);
    view.x += forward * c * level - left * s;
    view.y += forward * s * level + left * c;
    view.z += up - forward * Math.sin(view.pitch);
    view.yaw += turn;
    view.pitch = Math.max(-1.5, Math.min(1.5, view.pitch + down));
    view.camera = null;
    show_camera();
    draw(true);
  };

  // ---- the scene's lists --------------------------------------------------------------------
  const class_of = (id) => scene.classes.find((c) => c.id === id);
  const instance_of = (id) => scene.instances.find((i) => i.id === id);
  const class_name = (id) => (class_of(id) || { name: "void" }).name;

  const swatch = (color) => {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    svg.setAttribute("viewBox", "0 0 2 2");
    for (const [key, value] of Object.entries({ cx: 1, cy: 1, r: 1, fill: color })) dot.setAttribute(key, value);
    svg.append(dot);
    return svg;
  };

  const list_objects = () => {
    const groups = [];
    const named = [...scene.classes].filter((c) => c.thing).sort((a, b) => a.name.localeCompare(b.name));
    for (const c of [...named, { id: 0, name: "without a class", color: "#282828" }]) {
      const members = scene.instances.filter((i) => (class_of(i.class) && class_of(i.class).thing ? i.class : 0) === c.id);
      if (members.length === 0) continue;
      groups.push(element("h3", {}, swatch(c.color), `${c.name} (${members.length})`));
      for (const i of members) {
        const row = element("button", { "data-instance": i.id, onclick: () => click_instance(i.id) },
          element("span", {}, i.name), element("span", { class: "count" }, i.surfels.toLocaleString("en")));
        row.addEventListener("mouseenter", () => hover(i.id));
        row.addEventListener("mouseleave", () => hover(0));
        groups.push(row);
      }
    }
    fill(node("objects"), ...(groups.length ? groups : [element("p", { class: "faint" }, "No objects.")]));
    mark_rows();
  };
  const mark_rows = () => {
    for (const row of node("objects").querySelectorAll("button")) {
      row.classList.toggle("chosen", Number(row.dataset.instance) === chosen);
      row.classList.toggle("hovered", Number(row.dataset.instance) === hovered);
    }
  };

  const button_text = (button, word, what) => {
    button.disabled = what === null;
    button.textContent = what === null ? word : `${word}: ${what}`;
    button.title = what === null ? "" : what;
  };
  const show_scene = (fresh) => {
    scene = fresh;
    node("title").textContent = `Labels of ${scene.name}`;
    document.title = `Labels of ${scene.name}`;
    node("facts").textContent = `${scene.instances.length} objects, ${scene.surfels.toLocaleString("en")} surfels, ` +
      `${scene.void_surfels.toLocaleString("en")} of them void; ${scene.edits} ${scene.edits === 1 ? "edit" : "edits"}`;
    button_text(node("undo"), "Undo", scene.undo);
    button_text(node("redo"), "Redo", scene.redo);
    fill(node("classes"), ...scene.classes.map((c) => element("option", { value: c.name })));
    if (!instance_of(chosen)) chosen = 0;
    list_objects();
    show_chosen();
  };

  const show_kind = () => {
    const name = node("class").value.trim();
    node("new-kind").classList.toggle("hidden", name === "" || scene.classes.some((c) => c.name === name));
  };
  const show_chosen = () => {
    const of = instance_of(chosen);
    node("tools").classList.toggle("hidden", !of);
    node("chosen-name").textContent = of ? of.name : "Nothing is chosen";
    if (!of) {
      node("chosen-facts").textContent = "Click an object in the view, or in the list.";
      return;
    }
    const size = of.low ? `, ${of.high.map((v, k) => (v - of.low[k]).toFixed(2)).join(" x ")} m` : "";
    node("chosen-facts").textContent = `number ${of.id}, ${class_name(of.class)}, ${of.surfels.toLocaleString("en")} surfels${size}`;
    node("class").value = class_name(of.class);
    node("name").value = "";
    node("name").placeholder = of.name;
    show_kind();
  };

  const show_mode = () => {
    node("mode").classList.toggle("hidden", mode === null);
    node("mode-do").classList.toggle("hidden", !mode || mode.kind !== "cut" || !both_parts());
    if (!mode) return paint();
    if (mode.kind === "merge") {
      node("mode-text").textContent = "Click the object that it is a part of.";
    } else {
      const count = (part) => mode.seeds.filter((seed) => seed.part === part).length;
      node("mode-text").textContent = count(0) === 0 ? "Click the part that keeps the number." :
        count(1) === 0 ? "Click the other part." :
        `${count(0)} and ${count(1)} clicks: cut, or click more of the other part (with shift: of the first).`;
    }
    paint();
  };
  const both_parts = () => [0, 1].every((part) => mode.seeds.some((seed) => seed.part === part));
  const stop_mode = () => { mode = null; show_mode(); };

  const choose = (id) => {
    chosen = instance_of(id) ? id : 0;
    mode = null;
    show_chosen();
    mark_rows();
    const row = node("objects").querySelector(".chosen");
    if (row) row.scrollIntoView({ block: "nearest" });
    show_mode();
  };
  const hover = (id) => {
    if (id === hovered) return;
    hovered = id;
    mark_rows();
    paint();
  };
  const click_instance = (id) => {
    if (mode && mode.kind === "merge" && id !== chosen) return merge_into(id);
    choose(id);
  };

  // ---- edits --------------------------------------------------------------------------------
  const edit = async (what, then = chosen) => {
    if (busy) return;
    busy = true;
    say("Saving ...");
    try {
      const response = await fetch("/api/edits", {
        method: "POST", headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ revision: scene.revision, ...what }) });
      const answer = await response.json();
      if (!response.ok) {
        // Whatever went wrong, what is shown is what the server has.
        show_scene(await segsim.get_json("/api/scene"));
        throw new Error(answer.error);
      }
      chosen = then;
      mode = null;
      show_scene(answer);
      show_mode();
      say(`${answer.said}. Saved.`, "done");
    } catch (error) {
      complain(error);
    }
    busy = false;
    draw();
  };
  const merge_into = (id) => edit({ do: "merge", instance: chosen, into: id }, id);
  const need_chosen = (action) => () => (chosen ? action() : say("Choose an object first.", "error"));
  const rename = need_chosen(() => {
    const what = { do: "rename", instance: chosen, class: node("class").value.trim(), thing: node("thing").checked };
    if (node("name").value.trim() !== "") what.name = node("name").value.trim();
    canvas.focus();
    return edit(what);
  });
  const merge = need_chosen(() => { mode = { kind: "merge" }; show_mode(); });
  const cut = need_chosen(() => { mode = { kind: "cut", seeds: [] }; show_mode(); });
  const finish_cut = () => edit({ do: "cut", instance: chosen, gap_m: Number(node("gap").value),
    seeds: mode.seeds.map((seed) => [seed.part, ...seed.p_m]) });
  const pieces = need_chosen(() => edit({ do: "pieces", instance: chosen, gap_m: Number(node("gap").value) }));
  const remove = need_chosen(() => edit({ do: "delete", instance: chosen }, 0));
  const undo = () => edit({ do: "undo" });
  const redo = () => edit({ do: "redo" });

  // ---- clicks -------------------------------------------------------------------------------
  const seed_at = async (event) => {
    const part = mode.seeds.length === 0 || event.shiftKey ? 0 : 1;
    const picked = await pick(event);
    if (!mode || mode.kind !== "cut") return;
    if (picked.instance !== chosen || !picked.p_m) return say("Click on the chosen object.", "error");
    mode.seeds.push({ part, ...picked });
    show_mode();
  };
  const click = (event) => {
    const there = under(event);
    if (!there) return;
    if (mode && mode.kind === "cut") return seed_at(event).catch(complain);
    if (there.instance === 0) {
      say(`There is no object there: ${class_name(there.of_class)}.`);
      return mode ? undefined : choose(0);
    }
    click_instance(there.instance);
  };

  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    drag = { x: event.clientX, y: event.clientY, from_x: event.clientX, from_y: event.clientY, moved: false, button: event.button };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) {
      const there = under(event);
      if (!there) return;
      hover(there.instance);
      const of = instance_of(there.instance);
      node("under").textContent = of ? `${of.name} (${class_name(of.class)})` : class_name(there.of_class);
      return;
    }
    if (Math.hypot(event.clientX - drag.from_x, event.clientY - drag.from_y) > kDrag_px) drag.moved = true;
    if (!drag.moved) return;
    const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
    [drag.x, drag.y] = [event.clientX, event.clientY];
    if (drag.button === 2) move(0, 0.006 * dx, 0.006 * dy);
    else move(0, 0, 0, 0.003 * dx, -0.003 * dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    const clicked = drag && !drag.moved && drag.button === 0;
    drag = null;
    if (clicked) click(event);
  });
  canvas.addEventListener("pointercancel", () => { drag = null; });
  canvas.addEventListener("pointerleave", () => hover(0));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move(-0.002 * event.deltaY, 0, 0);
  }, { passive: false });

  // ---- keys ---------------------------------------------------------------------------------
  const keys = {
    w: () => move(kStep_m, 0, 0), s: () => move(-kStep_m, 0, 0), a: () => move(0, kStep_m, 0), d: () => move(0, -kStep_m, 0),
    q: () => move(0, 0, -kStep_m), e: () => move(0, 0, kStep_m),
    arrowleft: () => move(0, 0, 0, kTurn_rad), arrowright: () => move(0, 0, 0, -kTurn_rad),
    arrowup: () => move(0, 0, 0, 0, -kTurn_rad), arrowdown: () => move(0, 0, 0, 0, kTurn_rad),
    "[": () => beside(-1), "]": () => beside(1),
    f: need_chosen(() => face(instance_of(chosen))),
    n: need_chosen(() => { node("class").focus(); node("class").select(); }),
    m: merge, c: cut, x: pieces, delete: remove,
    o: () => { node("overlay").value = Number(node("overlay").value) > 0 ? 0 : 0.5; paint(); },
    enter: () => { if (mode && mode.kind === "cut" && both_parts()) finish_cut(); },
    escape: () => (mode ? stop_mode() : choose(0)),
    "?": () => node("keys").showModal(),
  };
  document.addEventListener("keydown", (event) => {
    if (!scene || node("keys").open) return;
    const typing = ["INPUT", "SELECT"].includes(event.target.tagName) && event.target.type !== "range";
    const key = event.key.toLowerCase();
    if (typing) {
      if (key === "escape") canvas.focus();
      return;
    }
    if (event.ctrlKey || event.metaKey) {
      if (key !== "z" && key !== "y") return;
      event.preventDefault();
      (key === "y" || event.shiftKey ? redo : undo)();
      return;
    }
    if (event.altKey || !keys[key]) return;
    if (event.target.tagName === "BUTTON" && key === "enter") return;
    event.preventDefault();
    keys[key]();
  });

  for (const [id, action] of Object.entries({ undo, redo, merge, cut, pieces, face: keys.f, delete: remove, "mode-do": finish_cut,
    "mode-stop": stop_mode, "camera-back": () => beside(-1), "camera-forward": () => beside(1),
    help: () => node("keys").showModal() })) {
    node(id).addEventListener("click", action);
  }
  node("rename").addEventListener("submit", (event) => { event.preventDefault(); rename(); });
  node("class").addEventListener("input", show_kind);
  node("overlay").addEventListener("input", paint);
  node("camera").addEventListener("change", () => { if (node("camera").value !== "") to_camera(Number(node("camera").value)); });

  // ---- begin --------------------------------------------------------------------------------
  (async () => {
    try {
      const [first, path] = await Promise.all([segsim.get_json("/api/scene"), segsim.get_json("/api/cameras")]);
      cameras = path.cameras;
      node("gap").value = first.gap_m;
      fill(node("camera"), element("option", { value: "" }, "free camera"),
        ...cameras.map((c, k) => element("option", { value: k }, `camera ${k}: ${c.frame}`)));
      show_scene(first);
      say(first.distributions ? "Edited objects get sharp borders; the others keep their label distributions." : "Ready.");
      // ?camera=12&object=3 in the address
      const first_camera = Math.min(Number(segsim.parameters.get("camera")) || 0, cameras.length - 1);
      view = cameras.length > 0 ? { ...cameras[first_camera], camera: first_camera } : { ...path.start, camera: null };
      show_camera();
      choose(Number(segsim.parameters.get("object")) || 0);
      await draw();
    } catch (error) {
      complain(error);
    }
    segsim.ready();
  })();
})();
