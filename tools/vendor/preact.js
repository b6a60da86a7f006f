export { render } from "preact";
export { useEffect, useLayoutEffect, useMemo, useRef } from "preact/hooks";
export { effect, signal, useComputed, useSignal } from "@preact/signals";
export { html } from "htm/preact";
