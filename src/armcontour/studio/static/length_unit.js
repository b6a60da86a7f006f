// Unit of lengths that tools in space show, and in which typed lengths are.

import { inches } from "./units.js";

/** Return the unit in which the page shows lengths, and its size [m]. @returns {{unit: string, factor: number}} */
export const lengthUnit = () => (inches.value ? { unit: "in", factor: 0.0254 } : { unit: "mm", factor: 1e-3 });
