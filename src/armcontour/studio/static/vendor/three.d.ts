// The part of three.js that the page uses; what is not listed here is left out of the bundle.
export {
  AmbientLight, ArrowHelper, AxesHelper, BackSide, Box3, BoxGeometry, BufferAttribute,
  BufferGeometry, CanvasTexture, CapsuleGeometry, Color, ConeGeometry, CylinderGeometry,
  DirectionalLight, DoubleSide, DynamicDrawUsage, EdgesGeometry, Euler, Float32BufferAttribute,
  FrontSide, GridHelper, Group, HemisphereLight, Line, LineBasicMaterial, LineDashedMaterial,
  LineLoop, LineSegments, MathUtils, Matrix3, Matrix4, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, MeshPhongMaterial, MeshStandardMaterial, Object3D, OrthographicCamera,
  PerspectiveCamera, Plane, PlaneGeometry, Points, PointsMaterial, Quaternion, Ray, Raycaster,
  REVISION, RingGeometry, Scene, Sphere, SphereGeometry, Sprite, SpriteMaterial, SRGBColorSpace,
  TorusGeometry, Vector2, Vector3, Vector4, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { TransformControls } from "three/examples/jsm/controls/TransformControls.js";
export { Line2 } from "three/examples/jsm/lines/Line2.js";
export { LineGeometry } from "three/examples/jsm/lines/LineGeometry.js";
export { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
export { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
export { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
