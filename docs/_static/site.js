// The entry of the current page is in view in the contents, also below a hundred others.
document.addEventListener("DOMContentLoaded", () => {
  const contents = document.querySelector(".sidebar-scroll");
  const entry = contents?.querySelector(".current-page");
  if (entry) contents.scrollTop += entry.getBoundingClientRect().top - contents.clientHeight / 2;
});
