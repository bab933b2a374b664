// What the page has to say when something does not work.

export function showMessage(text, dismissible = false) {
  const box = document.getElementById("message");
  box.hidden = text === "";
  box.querySelector("p").textContent = text;
  const button = box.querySelector("button");
  button.hidden = !dismissible;
  button.onclick = () => showMessage("");
  document.getElementById("loading").hidden = true;
}

export function sentence(error) {
  const text = String(error?.message ?? error);
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
}
