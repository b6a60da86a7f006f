// A stub: says hello, and lists the frames that arrive.
const token = location.hash.slice(1) || sessionStorage.getItem("token") || "";
sessionStorage.setItem("token", token);
history.replaceState(null, "", "/");
const socket = new WebSocket(`ws://${location.host}/socket`);
socket.binaryType = "arraybuffer";
socket.onopen = () => socket.send(JSON.stringify({ op: "hello", token }));
socket.onclose = () => { say("The server has ended."); };
socket.onmessage = ({ data }) => {
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  say(header.kind);
  const log = document.getElementById("log");
  if (log) log.textContent += `${JSON.stringify(header).slice(0, 200)}\n`;
};

/** @param {string} text */
function say(text) {
  const state = document.getElementById("state");
  if (state) state.textContent = text;
}
