// Outputs appear whole or not at all.
#include "rsfm/io/atomic_output.h"

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

int NumEntries(const fs::path& folder) {
  return static_cast<int>(std::distance(fs::directory_iterator(folder), {}));
}

TEST(AtomicFileTest, IsThereOnlyAfterCommit) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "a" / "b.txt";
  {
    auto file = AtomicFile::Create(path);
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->Write("whole"));
    EXPECT_FALSE(fs::exists(path));
    ASSERT_TRUE(file->Commit());
  }
  EXPECT_EQ(*ReadWholeFile(path), "whole");
  EXPECT_EQ(NumEntries(path.parent_path()), 1);
}

TEST(AtomicFileTest, AbandonedLeavesTheOldOne) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "b.txt";
  ASSERT_TRUE(WriteFileAtomically(path, "old"));
  {
    auto file = AtomicFile::Create(path);
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->Write(std::string(1 << 20, 'x')));
  }
  EXPECT_EQ(*ReadWholeFile(path), "old");
  EXPECT_EQ(NumEntries(folder.path()), 1);
}

TEST(AtomicFileTest, AFolderInItsPlaceIsRefused) {
  const TemporaryFolder folder;
  const auto file = AtomicFile::Create(folder.path());
  ASSERT_FALSE(file);
  EXPECT_EQ(ExitCode(file.error()), 2);
}

TEST(AtomicFolderTest, IsThereOnlyAfterCommit) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "model/";
  {
    auto output = AtomicFolder::Create(path);
    ASSERT_TRUE(output);
    ASSERT_TRUE(WriteFileAtomically(output->aside() / "f", "1"));
    EXPECT_FALSE(fs::exists(folder.path() / "model"));
    ASSERT_TRUE(output->Commit());
  }
  EXPECT_EQ(*ReadWholeFile(folder.path() / "model" / "f"), "1");
  EXPECT_EQ(NumEntries(folder.path()), 1);
}

TEST(AtomicFolderTest, AbandonedLeavesNothing) {
  const TemporaryFolder folder;
  {
    auto output = AtomicFolder::Create(folder.path() / "model");
    ASSERT_TRUE(output);
    ASSERT_TRUE(WriteFileAtomically(output->aside() / "f", "1"));
  }
  EXPECT_EQ(NumEntries(folder.path()), 0);
}

TEST(AtomicFolderTest, OnlyMissionsAndModelsAreReplaced) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "out";
  ASSERT_TRUE(WriteFileAtomically(path / "precious.txt", "1"));
  EXPECT_FALSE(AtomicFolder::Create(path, Existing::kRefuse));
  EXPECT_FALSE(AtomicFolder::Create(path, Existing::kReplace));
  ASSERT_TRUE(WriteFileAtomically(path / "rig.yaml", "old"));
  EXPECT_FALSE(AtomicFolder::Create(path, Existing::kRefuse));
  auto output = AtomicFolder::Create(path, Existing::kReplace);
  ASSERT_TRUE(output);
  ASSERT_TRUE(WriteFileAtomically(output->aside() / "rig.yaml", "new"));
  EXPECT_EQ(*ReadWholeFile(path / "rig.yaml"), "old");
  ASSERT_TRUE(output->Commit());
  EXPECT_EQ(*ReadWholeFile(path / "rig.yaml"), "new");
  EXPECT_FALSE(fs::exists(path / "precious.txt"));
  EXPECT_EQ(NumEntries(folder.path()), 1);
}

TEST(AtomicFolderTest, WhatADeadProcessLeftIsRemoved) {
  const TemporaryFolder folder;
  // No process has the largest possible number plus one.
  ASSERT_TRUE(fs::create_directory(folder.path() / ".out.partial-4194305"));
  const auto output = AtomicFolder::Create(folder.path() / "out");
  ASSERT_TRUE(output);
  EXPECT_EQ(NumEntries(folder.path()), 1);
}

}  // namespace
}  // namespace rsfm
