// Unit of lengths that tools in space show, and in which typed lengths are.

import { inches } from "./units.js";

/** Units of lengths in job files; a coordinate without a unit is in metres. */
const LENGTHS = new Set(["", "m", "mm", "cm", "in"]);

/** Return the unit in which the page shows the coordinates of a file; other units, such as degrees, stay. @param {[string, number]} unit of the file @returns {[string, number]} name and size [SI] */
export function coordinateUnit(unit) {
  const { unit: name, factor } = lengthUnit();
  return inches.value && LENGTHS.has(unit[0]) ? [name, factor] : unit;
}

/** Return the unit in which the page shows lengths, and its size [m]. @returns {{unit: string, factor: number}} */
export const lengthUnit = () => (inches.value ? { unit: "in", factor: 0.0254 } : { unit: "mm", factor: 1e-3 });
