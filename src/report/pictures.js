"use strict";
// Pictures of floats: decoding, exposure, differences, and a wipe between two.

/// { width, height, channels: 3, data: Float32Array } of a picture: high bytes of half floats above, low bytes below, in a PNG.
async function decoded(picture) {
  const raw = Uint8Array.from(atob(picture.png), (c) => c.charCodeAt(0));
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const bitmap = await createImageBitmap(new Blob([raw], { type: "image/png" }), options);
  const { width, height } = picture;
  const canvas = make("canvas", { width, height: 2 * height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  const bytes = context.getImageData(0, 0, width, 2 * height).data;
  const numbers = new Float32Array(width * height * 3);
  const low = width * height * 4;
  for (let pixel = 0; pixel < width * height; pixel++) {
    for (let c = 0; c < 3; c++) numbers[3 * pixel + c] = half((bytes[4 * pixel + c] << 8) | bytes[low + 4 * pixel + c]);
  }
  return { width, height, data: numbers };
}

/// The number that 16 bits mean: sign, 5 bits of exponent, 10 bits of mantissa.
function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const mantissa = bits & 1023;
  if (exponent === 31) return mantissa ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 25) * (1024 + mantissa) : 2 ** -24 * mantissa);
}

/// sRGB, 0..255.
function encoded(linear) {
  if (!(linear > 0)) return 0;
  const x = linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055;
  return Math.min(255, Math.round(255 * x));
}

/// Fills a canvas with `colour(pixel, put)` for each pixel.
function fill(canvas, width, height, colour) {
  if (canvas.width !== width || canvas.height !== height) (canvas.width = width), (canvas.height = height);
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  for (let pixel = 0; pixel < width * height; pixel++) {
    const [r, g, b] = colour(pixel);
    image.data.set([r, g, b, 255], 4 * pixel);
  }
  context.putImageData(image, 0, 0);
}

/// Radiance at so many stops; what is not a number is magenta.
function paint(canvas, image, stops) {
  const gain = 2 ** stops;
  const at = (i) => image.data[i];
  fill(canvas, image.width, image.height, (pixel) => {
    const [r, g, b] = [at(3 * pixel), at(3 * pixel + 1), at(3 * pixel + 2)];
    if (Number.isNaN(r + g + b)) return [255, 0, 255];
    return [encoded(gain * r), encoded(gain * g), encoded(gain * b)];
  });
}

/// Blue below, red above, white between: the ends differ in lightness from the middle alike, and in hue for the colour-blind.
const DIVERGING = [[33, 60, 140], [67, 130, 196], [160, 203, 229], [247, 247, 247], [244, 178, 138], [209, 84, 62], [123, 15, 38]];

function diverging(x) {
  const at = (Math.max(-1, Math.min(1, x)) + 1) * 0.5 * (DIVERGING.length - 1);
  const low = Math.min(Math.floor(at), DIVERGING.length - 2);
  return DIVERGING[low].map((c, k) => c + (DIVERGING[low + 1][k] - c) * (at - low));
}

/// The mean over channels of a − b for each pixel, and the size that 99 % of them stay below; b is taken at the nearest pixel if it has
/// another size.
function subtracted(a, b) {
  const values = new Float32Array(a.width * a.height);
  for (let y = 0; y < a.height; y++) {
    for (let x = 0; x < a.width; x++) {
      const i = 3 * (y * a.width + x);
      const j = 3 * (Math.floor((y * b.height) / a.height) * b.width + Math.floor((x * b.width) / a.width));
      let sum = 0;
      for (let c = 0; c < 3; c++) sum += a.data[i + c] - b.data[j + c];
      values[y * a.width + x] = sum / 3;
    }
  }
  const sizes = values.map(Math.abs).filter(Number.isFinite).sort();
  const scale = sizes.length ? sizes[Math.floor(0.99 * (sizes.length - 1))] || sizes[sizes.length - 1] : 0;
  return { width: a.width, height: a.height, values, scale: scale || 1e-6 };
}

function paintDifference(canvas, { width, height, values, scale }, stops) {
  const gain = 2 ** stops / scale;
  fill(canvas, width, height, (pixel) => (Number.isNaN(values[pixel]) ? [255, 0, 255] : diverging(gain * values[pixel])));
}

/// A slider in stops, and all that is painted again when it moves.
class Exposure {
  constructor() {
    this.stops = 0;
    this.painters = [];
    const told = make("output", {}, "0 stops");
    const input = make("input", { type: "range", min: -6, max: 6, step: 0.25, value: 0, "aria-label": "exposure in stops" });
    input.addEventListener("input", () => {
      this.stops = Number(input.value);
      told.textContent = `${this.stops > 0 ? "+" : ""}${shown(this.stops)} stops`;
      this.painters.forEach((paint) => paint());
    });
    this.control = make("label", {}, "exposure", input, told);
  }

  show(painter) {
    this.painters.push(painter);
    painter();
  }
}
