// Ghost of the executed tool in space: where the tool is beside the path, with a magnified error.

import { themed } from "./colours.js";
import { magnificationOf } from "./layers.js";
import { isWorking } from "./motion.js";
import { largest } from "./polylines.js";
import { along } from "./state.js";
import { Group, Matrix4, Mesh, MeshBasicMaterial, SphereGeometry, Vector3 } from "./vendor/three.js";

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./viewer.js").Viewer} Viewer */

const OPACITY = 0.35;
/** Radius of the dot at the tip of the ghost, as a share of the arm's size. */
const TIP = 0.006;

export class Ghost {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.material = new MeshBasicMaterial({ transparent: true, opacity: OPACITY, depthWrite: false });
    this.tip = new Mesh(new SphereGeometry(1, 12, 8), this.material);
    /** The bodies of the tool, in the frame of the last link. */
    this.bodies = new Group();
    this.bodies.matrixAutoUpdate = false;
    this.group = new Group().add(this.bodies, this.tip);
    this.group.visible = false;
    viewer.scene.add(this.group);
    /** Factor by which the error is magnified; 0: the ghost is not shown. */
    this.factor = 0;
    /** The error at the shown time, not magnified [m]. */
    this.error = 0;
    /** Factor of the last picture. */
    this.last = 1;
  }

  /** Take the bodies of the shown arm's tool. */
  readArm() {
    const { viewer, bodies, tip } = this;
    bodies.clear();
    for (const { solid, kind } of viewer.solids) {
      if (kind !== "tool") continue;
      const copy = new Mesh(solid.geometry, this.material);
      copy.matrixAutoUpdate = false;
      copy.matrix.copy(solid.matrix);
      bodies.add(copy);
    }
    tip.scale.setScalar(TIP * viewer.armSize);
  }

  /** Show the executed tool at a time. @param {Frame | null} executed null: no ghost @param {number} t s */
  show(executed, t) {
    const isShown = executed !== null && isWorking(executed, t);
    const wasShown = this.group.visible;
    this.group.visible = isShown;
    this.factor = 0;
    if (isShown) this.place(executed, t);
    if (isShown || wasShown) this.viewer.draw();
  }

  /** @param {Frame} executed @param {number} t s */
  place({ arrays }, t) {
    const { viewer, bodies, tip } = this;
    this.error = along(arrays.t, arrays.error, t)[0];
    this.factor = this.last = magnificationOf(largest(arrays.error) * this.pixels(), this.last);
    const [base, offset] = [arrays.base_xyz, arrays.offset_xyz].map((points) => new Vector3().fromArray(along(arrays.t, points, t, 3)));
    tip.position.copy(base.addScaledVector(offset, this.factor)).applyMatrix4(viewer.work);
    const moved = tip.position.clone().sub(viewer.tip.position);
    const last = viewer.links[viewer.links.length - 1];
    bodies.matrix.copy(new Matrix4().makeTranslation(moved.x, moved.y, moved.z).multiply(last));
    bodies.matrixWorldNeedsUpdate = true;
    this.material.color.set(themed("--executed"));
  }

  /** Return the size of a metre at the tool on the screen [px]. */
  pixels() {
    const { eye, host, tip } = this.viewer;
    const distance = eye.position.distanceTo(tip.position);
    return host.clientHeight / (2 * Math.tan((eye.fov * Math.PI) / 360) * distance);
  }
}
