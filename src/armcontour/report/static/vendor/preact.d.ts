export { render } from "preact";
export { useEffect, useLayoutEffect, useMemo, useRef } from "preact/hooks";
export { computed, signal, useComputed, useSignal } from "@preact/signals";
export { html } from "htm/preact";
