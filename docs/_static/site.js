// The entry of the current page is in view in the contents, also below a hundred others.
document.addEventListener("DOMContentLoaded", () => {
  const contents = document.querySelector(".sidebar-scroll");
  const entry = contents?.querySelector(".current-page");
  if (entry) contents.scrollTop += entry.getBoundingClientRect().top - contents.clientHeight / 2;
});

// Pictures that are not links open in full size.
document.addEventListener("click", (event) => {
  const image = event.target.closest?.("article img.large");
  if (!image) return;
  const dialog = document.body.appendChild(document.createElement("dialog"));
  dialog.className = "picture";
  dialog.append(Object.assign(new Image(), { src: image.src, alt: image.alt }));
  dialog.addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => dialog.remove());
  dialog.showModal();
});
document.addEventListener("DOMContentLoaded", () => {
  for (const image of document.querySelectorAll("article img"))
    if (!image.closest("a")) image.classList.add("large");
});

// Rows of tables that are paragraphs on narrow pages have no heads: each cell gets its own.
document.addEventListener("DOMContentLoaded", () => {
  for (const table of document.querySelectorAll("table.stacked")) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    for (const row of table.querySelectorAll("tbody tr"))
      [...row.cells].forEach((cell, k) => {
        const text = cell.textContent.trim();
        // A name in the first column speaks for itself, a number does not.
        if (heads[k] && text && (k > 0 || !/[^\d\s.,]/.test(text))) cell.dataset.label = heads[k];
      });
  }
});
