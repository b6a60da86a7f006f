// The part of three.js that the page uses; what is not listed here is left out of the bundle.
export {
  AxesHelper, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DoubleSide, FrontSide, GridHelper, Group,
  LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, Object3D, OrthographicCamera, Scene, SphereGeometry,
  Vector3, WebGLRenderer,
} from "three";
export { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
export { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
export { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
