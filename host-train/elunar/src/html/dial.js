// An arrow to the Sun that is turned by hand: with the pointer, or with the arrow keys.

/**
 * Makes a canvas a dial. `changed` is given the azimuth, degrees clockwise from the top.
 * @returns what draws it: show(azimuth_deg, spread_deg, picture); the spread is one standard deviation, 0 for none; the picture lies under the arrow
 */
export function dial(canvas, changed) {
  let azimuth_deg = 315;
  let held = false;
  const turn = (event) => {
    const box = canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
    changed(Math.round((Math.atan2(x, -y) * 180) / Math.PI + 360) % 360);
  };
  canvas.addEventListener("pointerdown", (event) => {
    held = true;
    canvas.setPointerCapture(event.pointerId);
    turn(event);
  });
  canvas.addEventListener("pointermove", (event) => held && turn(event));
  canvas.addEventListener("pointerup", () => (held = false));
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -5, ArrowDown: -5, ArrowRight: 5, ArrowUp: 5 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    changed((azimuth_deg + by + 360) % 360);
  });
  let under;
  return (azimuth, spread_deg = 0, picture = under) => {
    [azimuth_deg, under] = [azimuth, picture];
    canvas.setAttribute("aria-valuemin", 0);
    canvas.setAttribute("aria-valuemax", 360);
    canvas.setAttribute("aria-valuenow", Math.round(azimuth));
    draw(canvas, azimuth, spread_deg, picture);
  };
}

function draw(canvas, azimuth_deg, spread_deg, picture) {
  const pen = canvas.getContext("2d");
  const [size, style] = [canvas.width, getComputedStyle(canvas)];
  const radius = size / 2 - 8;
  const at = (deg) => ((deg - 90) * Math.PI) / 180;
  pen.reset();
  pen.translate(size / 2, size / 2);
  pen.lineWidth = 3;
  pen.strokeStyle = style.getPropertyValue("--faint");
  pen.beginPath();
  pen.arc(0, 0, radius, 0, 7);
  if (picture) {
    pen.save();
    pen.clip();
    const scale = (2 * radius) / Math.min(picture.width, picture.height);
    pen.drawImage(picture, (-picture.width * scale) / 2, (-picture.height * scale) / 2, picture.width * scale, picture.height * scale);
    pen.restore();
  }
  pen.stroke();
  if (spread_deg > 0) {
    pen.fillStyle = style.getPropertyValue("--band");
    pen.beginPath();
    pen.moveTo(0, 0);
    pen.arc(0, 0, radius, at(azimuth_deg - spread_deg), at(azimuth_deg + spread_deg));
    pen.fill();
  }
  pen.rotate(at(azimuth_deg));
  pen.strokeStyle = pen.fillStyle = style.getPropertyValue("--line-a");
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.lineTo(radius - 22, 0);
  pen.stroke();
  pen.beginPath();
  pen.arc(radius - 12, 0, 11, 0, 7);
  pen.fill();
}
