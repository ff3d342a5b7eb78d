// A view of a scene with its labels: asks the server for it, and paints.
"use strict";
// canvas   that is painted on
// current  says what is to be shown: {view, revision, classes, chosen, hovered, strength, seeds}
// complain is told what goes wrong
const label_view = (canvas, current, complain) => {
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  const kFull_px = 960, kMoving_px = 320;  // Widths of views at rest and on the way.
  const kChosen = [255, 200, 0];
  let shown = null;  // What the canvas shows: picture, ids, address.

  const address_of = (width) => {
    const { view } = current();
    const at = view.camera !== null ? `camera=${view.camera}`
      : ["x", "y", "z", "yaw", "pitch"].map((key) => `${key}=${view[key].toFixed(5)}`).join("&");
    return `${at}&width=${width}`;
  };

  // Runs of (instance, class, count) behind width and height.
  const ids_from = (bytes) => {
    const size = new DataView(bytes);
    const width = size.getUint32(0, true), height = size.getUint32(4, true);
    const runs = new Uint16Array(bytes.slice(8));
    const instance = new Uint16Array(width * height), of_class = new Uint16Array(width * height);
    for (let k = 0, at = 0; k < runs.length; k += 3) {
      instance.fill(runs[k], at, at + runs[k + 2]);
      of_class.fill(runs[k + 1], at, at + runs[k + 2]);
      at += runs[k + 2];
    }
    return { width, height, instance, of_class };
  };

  const rgb_of = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  // Colour under the labels; the border of every object, light; of the one pointed at, white.
  const paint = () => {
    if (!shown) return;
    const { width, height, instance, of_class } = shown.ids;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    pen.drawImage(shown.picture, 0, 0, width, height);
    const image = pen.getImageData(0, 0, width, height), out = image.data;
    const { classes, chosen, hovered, strength } = current();
    const colors = new Map(classes.map((c) => [c.id, rgb_of(c.color)]));
    for (let y = 0, i = 0; y < height; ++y) {
      for (let x = 0; x < width; ++x, ++i) {
        const id = instance[i];
        const right = x + 1 < width ? instance[i + 1] : id, below = y + 1 < height ? instance[i + width] : id;
        const border = right !== id || below !== id;
        const of_chosen = chosen !== 0 && (id === chosen || right === chosen || below === chosen);
        const lit = id !== 0 && (id === chosen || id === hovered);
        const color = colors.get(of_class[i]) || [40, 40, 40];
        const shade = id === 0 ? 0.75 : 0.75 + 0.25 * ((id * 7 % 4) / 3);
        const share = lit ? Math.max(0.65, strength) : strength;
        for (let c = 0; c < 3; ++c) {
          let value = (1 - share) * out[4 * i + c] + share * shade * color[c];
          if (lit) value = 0.75 * value + 0.25 * (id === chosen ? kChosen[c] : 255);
          if (border && (lit || of_chosen || strength > 0)) value = of_chosen ? kChosen[c] : 255;
          out[4 * i + c] = value;
        }
      }
    }
    pen.putImageData(image, 0, 0);
    paint_seeds();
    fit();
  };

  // As large as there is room, whatever the size of the view.
  const fit = () => {
    const highest = Math.max(240, window.innerHeight - 230), aspect = canvas.width / canvas.height;
    const width = Math.min(canvas.parentElement.clientWidth, highest * aspect);
    canvas.style.width = `${Math.floor(width)}px`;
    canvas.style.height = `${Math.floor(width / aspect)}px`;
  };

  // Clicks of a cut that were made in this view.
  const paint_seeds = () => {
    for (const seed of current().seeds) {
      if (seed.at !== place_of(shown.address)) continue;
      pen.beginPath();
      pen.arc(seed.share_x * canvas.width, seed.share_y * canvas.height, canvas.width / 120, 0, 2 * Math.PI);
      pen.fillStyle = seed.part === 0 ? "#ffd000" : "#00c8ff";
      pen.fill();
      pen.strokeStyle = "#000";
      pen.stroke();
    }
  };
  const place_of = (address) => address.replace(/&width=.*/, "");

  // One request at a time; what was wanted last comes last.
  let wanted = null, drawing = false, rest = null;
  const draw = async (moving = false) => {
    clearTimeout(rest);
    if (moving) rest = setTimeout(() => draw(), 180);
    wanted = { address: address_of(moving ? kMoving_px : kFull_px), revision: current().revision };
    if (drawing) return;
    drawing = true;
    try {
      while (wanted) {
        const now = wanted;
        wanted = null;
        const [picture, ids] = await Promise.all([
          segsim.image(`/api/view.jpg?${now.address}&revision=${now.revision}`),
          segsim.get(`/api/view.ids?${now.address}&revision=${now.revision}`).then((reply) => reply.arrayBuffer())]);
        shown = { picture, ids: ids_from(ids), address: now.address };
        paint();
        document.documentElement.dataset.drawn = Number(document.documentElement.dataset.drawn || 0) + 1;
      }
    } catch (error) {
      complain(error);
    }
    drawing = false;
  };

  // Where a pointer is on the canvas, as shares of its width and height.
  const share_of = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  // Instance and class there; null beside the canvas.
  const under = (event) => {
    if (!shown) return null;
    const [sx, sy] = share_of(event), { width, height, instance, of_class } = shown.ids;
    const x = Math.floor(sx * width), y = Math.floor(sy * height);
    if (x < 0 || y < 0 || x >= width || y >= height) return null;
    return { instance: instance[y * width + x], of_class: of_class[y * width + x] };
  };
  // The same by the server, with the place in the world, and where it was clicked.
  const pick = async (event) => {
    const [share_x, share_y] = share_of(event), { address, ids } = shown;
    const pixel = `px=${Math.floor(share_x * ids.width)}&py=${Math.floor(share_y * ids.height)}`;
    const picked = await segsim.get_json(`/api/pick?${address}&${pixel}`);
    return { ...picked, share_x, share_y, at: place_of(address) };
  };
  window.addEventListener("resize", () => shown && fit());

  return { draw, paint, under, pick };
};
