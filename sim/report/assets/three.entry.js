export { BackSide, BufferAttribute, BufferGeometry, Color, ConeGeometry, DoubleSide, FrontSide, Group, Line, LinearSRGBColorSpace, LineSegments, Matrix4, Mesh, PerspectiveCamera, Quaternion, RawShaderMaterial, Scene, Sphere, SphereGeometry, Vector3, WebGLRenderer } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
