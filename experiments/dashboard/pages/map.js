// A floor from above with what a robot knows and did, on a canvas; shared by the live page and by finished trials.
"use strict";
const floor_map = (() => {
  const mode_colors = ["#8e6bbf", "#1e74c4", "#f07820", "#d22832", "#f07820"];

  // The floor plan of a scene; null while nobody says where it lies.
  const load = async (run, scene) => {
    const geometry = await segsim.get_json(segsim.run_address(run, "scenes", scene, "floor.json"));
    const image = await segsim.image(segsim.run_address(run, "scenes", scene, "floor.jpg"));
    return { ...geometry, image };
  };

  // Cells of the policy's map, tinted: unknown fades the floor, obstacles are dark.
  const tint = (image) => {
    const canvas = document.createElement("canvas");
    canvas.width = image.naturalWidth;
    canvas.height = image.naturalHeight;
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
    const colors = [[244, 245, 247, 175], [0, 0, 0, 0], [60, 40, 90, 170], [120, 100, 160, 45]];
    for (let k = 0; k < pixels.data.length; k += 4) {
      pixels.data.set(colors[Math.min(3, Math.round(pixels.data[k] / 85))], k);
    }
    context.putImageData(pixels, 0, 0);
    return canvas;
  };

  // Draws `what`: {floor, cells, cells_place, goal_class, goal_instances, way, view_points, path, frontiers, objects, target, start, pose}.
  // Positions in metres, y up; path entries are [x, y, mode].
  const draw = (canvas, what) => {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);

    const box = extent(what);
    const scale = Math.min((width - 16) / box.width, (height - 16) / box.height);
    const left = (width - scale * box.width) / 2, top = (height - scale * box.height) / 2;
    const at = (x, y) => [left + scale * (x - box.x), top + scale * (box.y + box.height - y)];
    const raster = (image, x, y, w, h) => {
      const [px, py] = at(x, y + h);
      context.drawImage(image, px, py, scale * w, scale * h);
    };
    if (what.floor) {
      const { origin, size, px_per_m, image } = what.floor;
      raster(image, origin[0], origin[1], size[0] / px_per_m, size[1] / px_per_m);
    }
    if (what.cells && what.cells_place.resolution_m > 0) {
      // Its first row is the lowest y.
      const { origin, resolution_m, size } = what.cells_place;
      const [px, py] = at(origin[0], origin[1]);
      const across = scale * resolution_m * size[0], up = scale * resolution_m * size[1];
      context.save();
      context.beginPath();
      context.rect(left, top, scale * box.width, scale * box.height);
      context.clip();
      // Beyond the cells nothing is known either.
      context.beginPath();
      context.rect(left, top, scale * box.width, scale * box.height);
      context.rect(px, py - up, across, up);
      context.fillStyle = "rgba(244, 245, 247, 0.69)";
      context.fill("evenodd");
      context.imageSmoothingEnabled = false;
      context.translate(px, py);
      context.scale(1, -1);
      context.drawImage(what.cells, 0, 0, across, up);
      context.restore();
    }
    const line = (points, color, thick, dash = []) => {
      if (points.length < 2) return;
      context.beginPath();
      points.forEach(([x, y], k) => (k ? context.lineTo(...at(x, y)) : context.moveTo(...at(x, y))));
      context.strokeStyle = color;
      context.lineWidth = thick;
      context.lineJoin = "round";
      context.lineCap = "round";
      context.setLineDash(dash);
      context.stroke();
      context.setLineDash([]);
    };
    const disc = ([x, y], radius, fill, rim) => {
      context.beginPath();
      context.arc(...at(x, y), radius, 0, 7);
      context.fillStyle = fill;
      context.fill();
      if (rim) {
        context.strokeStyle = rim;
        context.lineWidth = 1.5;
        context.stroke();
      }
    };
    for (const object of what.floor ? what.floor.objects : []) {
      if (!segsim.is_goal(object, what)) continue;
      const [x0, y0] = at(object.low[0], object.high[1]), [x1, y1] = at(object.high[0], object.low[1]);
      context.fillStyle = "rgba(10, 150, 70, 0.18)";
      context.fillRect(x0, y0, x1 - x0, y1 - y0);
      context.strokeStyle = "#0a9646";
      context.lineWidth = 2;
      context.strokeRect(x0, y0, x1 - x0, y1 - y0);
    }
    for (const point of what.view_points || []) disc(point, 1.8, "rgba(60, 190, 110, 0.7)");
    line(what.way || [], "#646e6e", 1.5, [5, 4]);
    for (const point of what.frontiers || []) disc(point, 3.2, "#f5be00");
    const path = what.path || [];
    for (let k = 1, from = 0; k <= path.length; ++k) {
      if (k < path.length && path[k][2] === path[from][2]) continue;
      line(path.slice(Math.max(0, from - 1), k), mode_colors[path[from][2]] || "#22262b", 3);
      from = k;
    }
    for (const [x, y, is_goal] of what.objects || []) {
      disc([x, y], is_goal ? 5.5 : 2.5, is_goal ? "#c81482" : "#8a8f96", "#fff");
    }
    if (what.target) {
      const [x, y] = at(...what.target);
      context.strokeStyle = "#c81482";
      context.lineWidth = 2;
      context.strokeRect(x - 6, y - 6, 12, 12);
    }
    if (what.start) disc(what.start, 5, "#fff", "#2d323c");
    if (what.pose) robot(context, at(what.pose[0], what.pose[1]), what.pose[2], scale);
    scale_bar(context, scale, left + 8, top + scale * box.height - 8);
  };

  const extent = (what) => {
    if (what.floor) {
      const { origin, size, px_per_m } = what.floor;
      return { x: origin[0], y: origin[1], width: size[0] / px_per_m, height: size[1] / px_per_m };
    }
    const points = [...(what.path || []), ...(what.way || []), what.pose || what.start || [0, 0]];
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const x = Math.min(...xs) - 1, y = Math.min(...ys) - 1;
    return { x, y, width: Math.max(4, Math.max(...xs) + 1 - x), height: Math.max(4, Math.max(...ys) + 1 - y) };
  };

  // An arrow head; its field of view as a faint wedge.
  const robot = (context, [x, y], yaw, scale) => {
    context.save();
    context.translate(x, y);
    context.rotate(-yaw);
    const reach = Math.max(26, 1.2 * scale);
    context.beginPath();
    context.moveTo(0, 0);
    context.arc(0, 0, reach, -0.61, 0.61);
    context.closePath();
    context.fillStyle = "rgba(34, 38, 43, 0.13)";
    context.fill();
    const size = Math.max(8, 0.28 * scale);
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-0.7 * size, 0.7 * size);
    context.lineTo(-0.35 * size, 0);
    context.lineTo(-0.7 * size, -0.7 * size);
    context.closePath();
    context.fillStyle = "#22262b";
    context.fill();
    context.strokeStyle = "#fff";
    context.lineWidth = 1.5;
    context.stroke();
    context.restore();
  };

  const scale_bar = (context, scale, x, y) => {
    context.fillStyle = "rgba(255, 255, 255, 0.75)";
    context.fillRect(x - 4, y - 16, scale + 8, 20);
    context.strokeStyle = "#22262b";
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + scale, y);
    context.stroke();
    context.fillStyle = "#22262b";
    context.font = "11px system-ui, sans-serif";
    context.fillText("1 m", x, y - 4);
  };

  // Boxes over a picture of `size` camera pixels: [label, score, x0, y0, x1, y1, is_goal].
  const draw_boxes = (canvas, size, boxes) => {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    const sx = canvas.width / size[0], sy = canvas.height / size[1];
    context.font = `${Math.round(12 * ratio)}px system-ui, sans-serif`;
    for (const [label, score, x0, y0, x1, y1, is_goal] of boxes) {
      context.strokeStyle = is_goal ? "#ff2fa0" : "rgba(235, 238, 242, 0.8)";
      context.lineWidth = (is_goal ? 2.5 : 1) * ratio;
      context.strokeRect(sx * x0, sy * y0, sx * (x1 - x0), sy * (y1 - y0));
      const text = `${label} ${score.toFixed(2)}`;
      const x = sx * x0 + 2 * ratio, y = Math.max(12 * ratio, sy * y0 - 4 * ratio);
      context.lineWidth = 3 * ratio;
      context.strokeStyle = "rgba(0, 0, 0, 0.7)";
      context.strokeText(text, x, y);
      context.fillStyle = is_goal ? "#ff8fd0" : "#e7eaee";
      context.fillText(text, x, y);
    }
  };

  return { load, tint, draw, draw_boxes };
})();
