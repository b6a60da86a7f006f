// Frames of the server: u32 length of the header | header (JSON) | padding to 8 | arrays.
// The arrays are little endian and start at multiples of 8. They are views, not copies.

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */

const TYPES = /** @type {Record<string, any>} */ ({
  f4: Float32Array,
  f8: Float64Array,
  u1: Uint8Array,
  u2: Uint16Array,
  u4: Uint32Array,
  i4: Int32Array,
});

/**
 * Decode a frame from its bytes.
 * @param {ArrayBuffer} bytes @returns {Frame}
 */
export function unpack(bytes) {
  const length = new DataView(bytes).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const start = Math.ceil((4 + length) / 8) * 8;
  /** @type {Record<string, Numbers>} */
  const arrays = {};
  for (const [name, told] of Object.entries(head.arrays ?? {})) {
    const { type, shape, at } = /** @type {{type: string, shape: number[], at: number}} */ (told);
    const count = shape.reduce((/** @type {number} */ all, /** @type {number} */ n) => all * n, 1);
    arrays[name] = new TYPES[type](bytes, start + at, count);
  }
  return { kind: head.kind, seq: head.seq ?? null, rev: head.rev ?? 0, head, arrays, asked: 0 };
}
