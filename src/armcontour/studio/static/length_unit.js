// Unit of lengths that tools in space show, and in which typed lengths are.

/** Return the unit in which the page shows lengths, and its size [m]. @returns {{unit: string, factor: number}} */
export const lengthUnit = () => ({ unit: "mm", factor: 1e-3 });
