// Connection to the server: sends the token and messages, passes frames to the store.
// At most a few edits are in flight and one is pending, so that no queue grows while a handle is dragged. The server
// skips all but the newest edit, so it follows the pointer and never waits until the page has drawn.

import { unpack } from "./message_frame.js";

/** @typedef {import("./state.js").Store} Store */
/**
 * State of the connection, sent as the event `link`: "starting", "open", "lost" (the page tries again) or
 * "refused" (it does not); `sentence` is for the user, `busy` is true while an edit has no answer. With `stopped`, no server
 * answers at the address, so it has ended or was killed; `lost` tells whether an edit had no answer then.
 * @typedef {{state: "starting" | "open" | "lost" | "refused", sentence: string, busy: boolean, stopped?: boolean, lost?: boolean}} LinkState
 */
/** @typedef {Record<string, any> & {op: string}} Message */

/** Messages that the server answers with the changed document. @param {Message} message */
const isChange = ({ op, final }) => Boolean(final) || op === "undo" || op === "redo" || op === "select";

const KEPT_AS = "armcontour-token";
const FIRST_WAIT = 250; // ms
const LONGEST_WAIT = 4000;
// A server without an answer for this long has ended; a new server has another address.
const GIVE_UP_AFTER = 15_000;
// Maximum number of edits without an answer; the screen may be faster than the server.
const MAX_IN_FLIGHT = 3;
// An edit without an answer for this long no longer holds back the next one.
const ANSWER_WITHIN = 2000;
const REFUSED = "Open the address that `armcontour studio` printed last; it may be pasted into this tab.";
const ENDED = "The Studio was stopped";

/** True if the address contains a token; other hashes are anchors in the page. */
const hasToken = () => /^#[0-9a-f]{32}$/.test(location.hash);

/** Return the token and remove it from the address; without one, the token that this tab stores. @returns {string | null} */
function takeToken() {
  if (hasToken()) {
    sessionStorage.setItem(KEPT_AS, location.hash.slice(1));
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem(KEPT_AS);
}

export class Link {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.token = takeToken();
    /** @type {WebSocket | null} */
    this.socket = null;
    /** @type {LinkState} */
    this.state = { state: "starting", sentence: "Starting", busy: false };
    this.seq = 0;
    this.gestures = 0;
    this.wait = FIRST_WAIT;
    /** When the connection was lost; 0 while it is open. */
    this.lost = 0;
    /** True if an edit had no answer when it was lost. */
    this.isChangeLost = false;
    this.retry = 0;
    /** @type {number[]} edits that have no answer yet, by seq */
    this.inFlight = [];
    this.late = 0;
    /** @type {Message[]} waiting edits; of each gesture only the last one */
    this.pending = [];
    /** Number of the newest change whose document has not arrived; 0 if the page has the newest document. */
    this.change = 0;
    /** @type {(() => void)[]} functions that wait for this document */
    this.afterChange = [];
    /** @type {Map<number, number>} times at which messages were caused, by seq */
    this.causes = new Map();
  }

  /** Connect, and reconnect whenever the connection is lost. */
  open() {
    clearTimeout(this.retry);
    if (!this.token) return this.tell("refused", REFUSED);
    const address = `ws://${location.host}/socket`;
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(JSON.stringify({ op: "hello", token: this.token }));
    socket.onmessage = (event) => socket === this.socket && this.receive(event.data);
    socket.onclose = (event) => socket === this.socket && this.closed(event);
    this.socket = socket;
  }

  /** Connect with the token of a new address in the same tab, for example after the server was restarted. */
  renew() {
    if (!hasToken()) return;
    this.token = takeToken();
    this.socket?.close();
    this.wait = FIRST_WAIT;
    this.lost = 0;
    this.tell("lost", "Connecting with the new address");
    this.open();
  }

  /** Return the number of a new gesture, a series of edits that is undone in one step. @returns {number} */
  newGesture() {
    return ++this.gestures;
  }

  /**
   * Send a message after all waiting edits.
   * @param {Message} message @returns {number} its seq, or -1 without a connection
   */
  send(message) {
    this.flush();
    return this.post(message);
  }

  /**
   * Send an edit, or keep it while too many have no answer. A later edit of the same gesture replaces a waiting one.
   * @param {object[]} edits all changes since the gesture's start
   * @param {{gesture?: number, final?: boolean, at?: number, result?: string}} [how] without: a gesture of its own; `at` is
   *   when the user moved (the event's time stamp), `result` a result that also applies to the changed job
   */
  edit(edits, { gesture = this.newGesture(), final = true, at = performance.now(), result } = {}) {
    if (this.state.state !== "open") return;
    const message = { op: "edit", gesture, final, edits, at, result };
    const last = this.pending.at(-1);
    if (last && last.gesture === gesture) this.pending.pop();
    this.pending.push(message);
    if (this.inFlight.length < MAX_IN_FLIGHT || final) this.flush();
  }

  /** Revert the gesture. */
  cancelGesture() {
    this.pending = [];
    this.post({ op: "cancel_gesture" });
  }

  /**
   * Send a request to the server outside of the connection, with the token.
   * @param {string} path @param {RequestInit} [init] @returns {Promise<Response>}
   */
  request(path, init = {}) {
    const headers = { ...init.headers, Authorization: `Bearer ${this.token}`, "X-Armcontour": "1" };
    return fetch(path, { ...init, headers });
  }

  /** Call a function as soon as the page has the document with all sent changes. @param {() => void} then */
  whenKnown(then) {
    if (this.change) this.afterChange.push(then);
    else then();
  }

  flush() {
    for (const message of this.pending.splice(0)) {
      const { at, ...rest } = message;
      const seq = this.post(/** @type {Message} */ (rest), at);
      if (seq >= 0) this.fly(seq);
    }
  }

  /** @param {Message} message @param {number} [at] when it was caused @returns {number} */
  post(message, at = performance.now()) {
    if (this.socket?.readyState !== WebSocket.OPEN) return -1;
    const seq = ++this.seq;
    if (isChange(message)) this.change = seq;
    this.causes.set(seq, at);
    if (this.causes.size > 200) this.causes.delete(/** @type {number} */ (this.causes.keys().next().value));
    this.socket.send(JSON.stringify({ ...message, seq }));
    return seq;
  }

  /** @param {number} seq */
  fly(seq) {
    this.inFlight.push(seq);
    clearTimeout(this.late);
    this.late = setTimeout(() => this.land(), ANSWER_WITHIN);
    this.setBusy(true);
  }

  /** Edits in flight have their answer, so send the next edit. @param {number} [seq] of the last of them; by default all are */
  land(seq = Infinity) {
    this.inFlight = this.inFlight.filter((x) => x > seq);
    if (this.pending.length) return this.flush();
    if (this.inFlight.length) return;
    clearTimeout(this.late);
    this.setBusy(false);
  }

  /** @param {ArrayBuffer} bytes */
  receive(bytes) {
    const frame = unpack(bytes);
    frame.asked = frame.seq === null ? 0 : (this.causes.get(frame.seq) ?? 0);
    if (this.state.state !== "open") {
      this.wait = FIRST_WAIT;
      this.lost = 0;
      this.isChangeLost = false;
      this.store.restart();
      this.tell("open", "Connected");
    }
    this.store.put(frame);
    this.answered(frame);
  }

  /** @param {import("./state.js").Frame} frame */
  answered(frame) {
    const isAnswer = frame.kind === "document" || (frame.kind === "failed" && frame.head.op);
    if (isAnswer && (frame.seq ?? -1) >= this.change) {
      this.change = 0;
      for (const then of this.afterChange.splice(0)) this.whenKnown(then);
    }
    if (frame.seq === null || !(this.inFlight[0] <= frame.seq)) return;
    // The server executes the plan while the next edit is on its way.
    if (["picture", "refusal", "executed", "failed", "notice"].includes(frame.kind)) this.land(frame.seq);
  }

  /** @param {CloseEvent} event */
  closed(event) {
    this.socket = null;
    this.isChangeLost ||= this.pending.length > 0 || this.inFlight.length > 0;
    // A server that is only out of reach for a moment answers the first attempt to connect again.
    const stopped = this.lost > 0;
    this.pending = [];
    this.afterChange = [];
    this.change = 0;
    this.land();
    if (event.code === 1008 || event.code >= 4000) return this.tell("refused", `${event.reason} ${REFUSED}`.trim());
    this.lost ||= performance.now();
    const facts = { stopped, lost: this.isChangeLost };
    if (performance.now() > this.lost + GIVE_UP_AFTER) return this.tell("refused", ENDED, facts);
    this.tell("lost", stopped ? ENDED : "The connection is interrupted; the page connects again.", facts);
    this.retry = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
  }

  /** @param {boolean} busy */
  setBusy(busy) {
    if (busy === this.state.busy) return;
    this.state = { ...this.state, busy };
    this.store.tell("link", this.state);
  }

  /** @param {LinkState["state"]} state @param {string} sentence @param {{stopped?: boolean, lost?: boolean}} [facts] */
  tell(state, sentence, facts = {}) {
    this.state = { state, sentence, busy: false, ...facts };
    this.store.isOffline = state !== "open";
    this.store.tell("link", this.state);
  }
}
