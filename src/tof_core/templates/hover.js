// Values under the pointer, and zoom: click to magnify, drag to move, double click to go back. Numbers are in the pictures (tof_core/hover.py).
(() => {
  const NOTHING = -32768, CHUNK = "twNm", NEAR = 18, MOST = 12;
  const tip = document.createElement("div");
  tip.className = "tip";
  document.body.append(tip);

  async function numbersOf(img) {
    const head = "data:image/png;base64,";
    if (!img.src.startsWith(head)) return null;
    const png = Uint8Array.from(atob(img.src.slice(head.length)), (c) => c.charCodeAt(0));
    const view = new DataView(png.buffer);
    for (let at = 8; at + 12 <= png.length; at += 12 + view.getUint32(at)) {
      if (String.fromCharCode(...png.subarray(at + 4, at + 8)) !== CHUNK) continue;
      const body = new Blob([png.subarray(at + 8, at + 8 + view.getUint32(at))]).stream();
      const raw = await new Response(body.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
      const length = new DataView(raw).getUint32(0, true);
      const axes = JSON.parse(new TextDecoder().decode(new Uint8Array(raw, 4, length))).axes;
      const part = (start, bytes) => raw.slice(4 + length + start, 4 + length + start + bytes);
      for (const a of axes) {
        if (a.image) a.image.data = new Int16Array(part(a.image.at, 2 * a.image.shape[0] * a.image.shape[1]));
        for (const s of a.series) s.data = new Float32Array(part(s.at, 16 * s.count));
      }
      return axes;
    }
    return null;
  }

  const short = (x) => (Math.abs(x) >= 1000 || x === Math.round(x) ? String(Math.round(x)) : x.toPrecision(3));

  function valueAt(axes, x, y, width, height) {
    const a = axes.find((b) => x >= b.box[0] && x <= b.box[2] && y >= b.box[1] && y <= b.box[3]);
    if (!a) return "";
    if (a.image) {
      const [rows, columns] = a.image.shape;
      const row = Math.min(rows - 1, Math.floor(((y - a.box[1]) / (a.box[3] - a.box[1])) * rows));
      const column = Math.min(columns - 1, Math.floor(((x - a.box[0]) / (a.box[2] - a.box[0])) * columns));
      const count = a.image.data[row * columns + column];
      const value = count === NOTHING ? "nothing here" : `${short(a.image.low + count * a.image.step)} ${a.image.unit}`;
      return `${value}\n${a.title ? a.title + ", " : ""}column ${column * a.image.every}, row ${row * a.image.every}`;
    }
    let best = null;
    for (const s of a.series) {
      for (let i = 0; i < s.count; i++) {
        const d = Math.hypot((s.data[4 * i] - x) * width, (s.data[4 * i + 1] - y) * height);
        if (d < NEAR && (!best || d < best.d)) best = { d, s, x: s.data[4 * i + 2], y: s.data[4 * i + 3] };
      }
    }
    return best ? `${best.s.name ? best.s.name + ": " : ""}${short(best.x)}, ${short(best.y)}` : "";
  }

  function enliven(img, axes) {
    const frame = document.createElement("div");
    frame.className = "zoom";
    img.replaceWith(frame);
    frame.append(img);
    img.draggable = false;
    let scale = 1, left = 0, top = 0, drag = null;
    const place = () => {
      const { width, height } = frame.getBoundingClientRect();
      left = Math.min(0, Math.max(left, width * (1 - scale)));
      top = Math.min(0, Math.max(top, height * (1 - scale)));
      img.style.transform = scale > 1 ? `translate(${left}px, ${top}px) scale(${scale})` : "";
      frame.classList.toggle("near", scale > 1);
    };
    frame.addEventListener("pointermove", (event) => {
      if (drag) {
        left += event.clientX - drag.x;
        top += event.clientY - drag.y;
        drag = { x: event.clientX, y: event.clientY, moved: true };
        place();
      }
      const r = img.getBoundingClientRect();
      tip.textContent = axes ? valueAt(axes, (event.clientX - r.left) / r.width, (event.clientY - r.top) / r.height, r.width, r.height) : "";
      tip.style.left = `${Math.min(event.clientX + 14, innerWidth - 230)}px`;
      tip.style.top = `${event.clientY + 16}px`;
    });
    frame.addEventListener("pointerleave", () => { tip.textContent = ""; drag = null; });
    frame.addEventListener("pointerdown", (event) => { drag = { x: event.clientX, y: event.clientY, moved: false }; });
    frame.addEventListener("pointerup", (event) => {
      const clicked = drag && !drag.moved && event.detail < 2 && event.pointerType !== "touch";
      drag = null;
      if (!clicked || scale * 2 > MOST) return;
      const r = frame.getBoundingClientRect();
      left = 2 * left - (event.clientX - r.left);
      top = 2 * top - (event.clientY - r.top);
      scale *= 2;
      place();
    });
    frame.addEventListener("dblclick", () => { scale = 1; left = top = 0; place(); });
  }

  for (const img of document.querySelectorAll("figure img, details img, .part img")) {
    numbersOf(img).then((axes) => enliven(img, axes), () => enliven(img, null));
  }
})();
